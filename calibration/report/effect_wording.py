# Copyright 2026 telescope_mount developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Words for one effect: its shape, its size, its causes, what to do about it."""

import re
from dataclasses import dataclass

import numpy as np

from msg_tools.units import ARCSEC, covered
from pointing_model.effects import Amount
from pointing_model.effects.base import arcsec, common_shape
from pointing_model.mount_kinds import USUAL

from . import cause_wording
from .cause_wording import plain_name, short_cause, still_open
from .driver_labels import driver_of, utc_text
from .period_wording import period_sentences
from .verdict_wording import Statement

#: degrees: a wider minimum or maximum is given as a range
_WIDE = 15.0
#: share of a turn: if less was observed, a periodic effect is reported with that range
_MOST_OF_TURN = 2.0 / 3.0
_NEIGHBOURS, _PLACES = 4, 12  # fewest rows per bin, largest number of bins of a driver
_ALIKE = 0.1  # tolerance, relative to the range of the bin means, of a minimum or maximum
_ROUND = 340.0  # degrees, range of a driver that covers the full circle and has no ends
_FOLLOWED = 0.5  # smallest share of the variance explained by the bin means


def effect_summaries(diagnosis):
    """Plain statements on each effect of a `Diagnosis`.

    Returns
    -------
    list of Statement
    """
    return [effect_summary(diagnosis, found) for found in diagnosis.effects]


def effect_summary(diagnosis, found):
    """`Statement` on one `DiagnosedEffect`: its shape and size; then its causes, the source of its
    driver, and its dependence on the last motion.
    """
    context = diagnosis.observations.context
    e = found.fitted.effect
    rms, used, more = found.removes_arcsec, diagnosis.weights > 0.0, []
    # the axis on which it is larger
    values = found.beyond[int(np.argmax(np.ptp(found.beyond, axis=1))) if used.any() else 0]
    alternatives = still_open(vars(found))
    if len(found.causes) > 1:
        where = acting_word(found, context.mount.names.axes, 'pointing')
        seen = ', '.join(filter(None, [f'The {where} error has {shape_of(found)}',
                                       _where(context, found, used, values)]))
        more.append(cause_wording.causes_sentence(found.causes))
    elif alternatives:
        where = acting_word(found, context.mount.names.axes, 'pointing')
        named = [short_cause(one['cause']) for one in (*found.causes, *alternatives)]
        shape = shape_of(found).replace(f' of the {where}', '', 1)
        seen = f'The {where} error has {shape}. Likely: {", or ".join(named)}'
    else:
        raw = context.get(e.driver)
        known = raw[np.isfinite(raw)] if raw is not None else np.zeros(0)
        utc = getattr(context, 'time_is_utc', True)
        seen = e.clause(Amount(
            found.fitted.coefficients / ARCSEC, rms,
            (known.min(), known.max()) if known.size else None,
            utc_text if utc and e.driver == 'time' else None))
    more.append(cause_wording.alternatives_sentence(vars(found), e.cause_summary))
    seen, observed = _as_observed(seen, context, e, used)
    own, places = _of_axis(context, e, found.fitted.coefficients / ARCSEC, used)
    more += [places, observed, *period_sentences(e)]
    memory = e.parameters.get('memory_deg')
    if memory:
        # the same hysteresis with another memory, or none, fits as well
        open_ = any(row['in_set'] and row['name'] != e.name and row['driver'] == e.driver
                    and 'hysteresis' in row['name'] for row in found.ranking)
        more.append('After a reversal the new side is reached gradually, most of it '
                    f'within {memory:g}° of motion (its memory)'
                    + ('; the data do not determine the distance.' if open_
                       else '. A short move shows less of it.'))
    # the part beyond the terms is at most as large as the effect itself
    reach = float(min(np.ptp(one, axis=1).max() for one in (
        found.beyond, found.offsets[:, used]))) if used.any() else 0.0
    return Statement(_lead(seen, rms, reach, own),
                     ' '.join(filter(None, [*more, _of_approach(diagnosis, e)])), reach)


def _lead(seen, rms, reach, own):
    """The shape and size of an effect: peak to peak and RMS on the sky beyond the declared terms,
    and the amplitude in the axis angle where it differs; arcsec.
    """
    if rms is None or not np.isfinite(rms):
        return f'{seen}.'
    reach = f'{arcsec(reach)} peak to peak, ' if reach else ''
    own = f'; \u00b1{arcsec(own)} in the angle of the axis' if own else ''
    return f'{seen}. Size: {reach}{arcsec(rms)} RMS on the sky{own}.'


def _as_observed(seen, context, e, used):
    """Adds the observed range to a periodic shape, if it is much less than a turn."""
    driver = driver_of(context, e.driver) if e.parameters.get('order') else None
    if driver is None or driver.levels or not driver.label.endswith('[°]') \
            or ' per turn' not in seen:
        return seen, ''
    span = np.degrees(covered(np.radians(driver.values[used]))[1])
    if span > _MOST_OF_TURN * 360.0:
        return seen, ''
    over = f'{span:.0f}°'
    return (seen.replace(' per turn', f' per turn over the {over} observed', 1),
            f'Of the turn {over} of 360° were observed: another number of times, or a curve that '
            'is no wave, may fit there as well.')


def _of_axis(context, e, values, used):
    """Amplitude of a wave of the first axis, which is smaller on the sky, and its maximum."""
    order = e.parameters.get('order')
    if e.form != 'encoder' or e.axes != 'az':
        return None, ''
    size, turn = float(np.hypot(*values)), 360.0 / order
    angles = driver_of(context, e.driver).values[used]
    middle = 0.5 * (angles.min() + angles.max())

    def near(at):
        return f'{at + turn * np.round((middle - at) / turn):.0f}°'.replace('-', '−')
    high = np.degrees(np.arctan2(values[1], values[0])) / order
    return size, (f'In the angle of the axis it is {arcsec(size, True)} near {near(high)} and '
                  f'{arcsec(-size)} near {near(high + 0.5 * turn)}; on the sky that is times '
                  f'cos {context.mount.names.letters[1]}.')


def _of_approach(diagnosis, e):
    """How the direction of approach was derived, if it was not measured."""
    derived = diagnosis.observations.run.meta.get('approach_from')
    kind, _, axis = e.driver.rpartition('_')
    if not derived or kind not in ('approach', 'travel', 'before') or axis not in derived['axes']:
        return ''
    order = 'in time' if derived['order'] == 'time' else 'of the rows'
    return (f'The direction of approach is no column of the file: it was derived from the order '
            f'{order}. It is wrong where the axis moved otherwise between two rows.')


def effect_title(found, axes):
    """Title of an effect: its cause, or its shape if the cause is open.

    Parameters
    ----------
    found : DiagnosedEffect
    axes : sequence of str
        Names of the angles of the mount.

    Returns
    -------
    str
    """
    e = found.fitted.effect
    if not (e.shape and (len(found.causes) > 1 or still_open(vars(found)) or e.kind == 'smooth')):
        return plain_name(e.name, e.parameters.get('mount', USUAL))
    where = acting_word(found, axes, '')
    # worded like plot labels
    shape = re.sub(r'^an? ', '', shape_of(found))
    shape = re.sub(r'^(\w+(?: \w+)?) of the ', r'\1 vs ', shape).replace(' or of the ', ' or ')
    return f'{where} error: {shape}' if where else f'both axes: {shape}'


def acting_word(found, axes, both):
    """The one of the `axes` on which an effect and all its causes act, else `both`."""
    acting = {one.get('axes', found.fitted.effect.axes) for one in _may_be(found)} or {
        found.fitted.effect.axes}
    return dict(zip(('az', 'el'), axes)).get(acting.pop(), both) if len(acting) == 1 else both


def _drivers(found):
    """Drivers of an effect and its causes, without duplicates."""
    own = found.fitted.effect.driver
    return list(dict.fromkeys(one.get('driver', own) for one in _may_be(found))) or [own]


def _may_be(found):
    """Its causes and their contenders."""
    return [*found.causes, *still_open(vars(found))]


def shape_of(found):
    """Shape common to an effect and all its possible causes."""
    e = found.fitted.effect
    return common_shape([one['shape'] for one in _may_be(found)] or [e.shape], _drivers(found))


def _where(context, found, used, values):
    """Where an effect is lowest and highest: sides or values of its driver; '' if neither."""
    e = found.fitted.effect
    driver = driver_of(context, e.driver)
    # with causes that depend on different angles, one of them does not locate the error
    if driver is None or len(_drivers(found)) > 1:
        return ''
    if driver.levels:
        return _sides(e, found.offsets[:, used], driver.values[used], driver.levels)
    places = ends(driver.values[used], values) if driver.label.endswith('[°]') else None
    return '' if places is None else ', '.join(
        f'{word} {_place(one)}' for word, one in zip(('lowest', 'highest'), places))


@dataclass
class Extreme:
    """Minimum or maximum along a driver.

    Attributes
    ----------
    at, low, high : float
        Its position, and the range in which it is hardly less extreme.
    end : bool
        Whether it is at the end of the rows: beyond there may be a lower or higher value.
    """

    at: float
    low: float
    high: float
    end: bool


def ends(driver, values):
    """Positions along a driver where values are lowest and highest.

    Means of bins are compared, not single rows: a value that also depends on the other axis, or
    changes sign through the pole, can have minimum and maximum at the same position.

    Parameters
    ----------
    driver, values : ndarray, shape (m,)

    Returns
    -------
    tuple of Extreme or None
        Minimum and maximum of the bin means; None if the bin means do not explain most of the
        variance.
    """
    known = np.isfinite(driver)
    driver, values = driver[known], values[known]
    parts = min(len(driver) // _NEIGHBOURS, _PLACES)
    if parts < 3:
        return None
    groups = np.array_split(np.argsort(driver, kind='stable'), parts)
    means = np.array([values[group].mean() for group in groups])
    between = sum(len(group) * (mean - values.mean())**2 for group, mean in zip(groups, means))
    if not between > _FOLLOWED * np.square(values - values.mean()).sum():
        return None
    places = np.array([np.median(driver[group]) for group in groups])
    alike = _ALIKE * np.ptp(means)
    round_ = np.ptp(driver) > _ROUND
    if not round_:
        places[[0, -1]] = driver.min(), driver.max()
    return tuple(_extreme(places, size <= size.min() + alike, int(size.argmin()), round_)
                 for size in (means, -means))


def _extreme(places, alike, k, round_):
    """`Extreme` in bin `k`, with the neighbours that are as low or as high."""
    low = high = k
    while low > 0 and alike[low - 1]:
        low -= 1
    while high + 1 < len(places) and alike[high + 1]:
        high += 1
    return Extreme(*(float(places[i]) for i in (k, low, high)),
                   bool(not round_ and (low == 0 or high == len(places) - 1)))


def _place(one):
    """An `Extreme` in words."""
    low, high = (f'{value:.0f}°'.replace('-', '−') for value in (one.low, one.high))
    if one.high - one.low > _WIDE and low != high:
        return f'from {low} to {high}'
    at = f'{one.at:.0f}°'.replace('-', '−')
    return f'at {at}, where the rows end' if one.end else f'near {at}'


def _sides(e, fitted, values, levels):
    """Mean difference between the two values of a two-valued driver, in words."""
    sides = [level for level in levels if level]
    if len(sides) != 2:
        return ''
    axis = {'az': 0, 'el': 1}.get(e.axes, int(np.argmax(np.ptp(fitted, axis=1))))
    means = [fitted[axis][values == level].mean() for level in sides]
    more, less = (sides if means[0] > means[1] else sides[::-1])
    after = 'after moving ' if e.driver.startswith('approach') else 'with '
    return (f'{arcsec(abs(means[0] - means[1]))} more on the sky {after}{levels[more]} than '
            f'{levels[less]}, on average')
