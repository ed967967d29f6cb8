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

"""Thermal effects: with a lag, by a thermometer on the mount, at the secondary mirror.

The temperature q of a heavy part follows the air as q' = (T - q) / tau (Newton's law of cooling,
one time constant). The air temperature comes from the rows and the log of the run. If these do not
begin early enough, the initial temperature of the part is a further parameter; it decays with tau.
"""

import re

import numpy as np

from pointing_model.mount_kinds import KINDS, USUAL
from pointing_model.pointing_terms import terms_of

from .base import Effect, Offer, arcsec, driver_word, effect, form, offer, the
from .drifts import about, moving, progress

#: time constants tried, s: half or double the value gives nearly the same curve
LAGS = tuple(60.0 * minutes for minutes in (10, 20, 40, 80, 160))
#: time constants after which the start of the log does not matter
BEFORE = 2.0
#: least fraction of its scatter by which the lagged temperature, or the decay from the start,
#: must differ from the temperature itself
_BENDS = 0.1
#: least lag, in steps from row to row
_STEPS = 1.5
_LATE = ('TF', 'CA')
_WARM = re.compile(r'temp|ambient|amb(_|$)|^t[_-]?(amb|air|tube|truss|mirror|dome|cell|steel)')


def lagged(context, driver, tau):
    """A driver lagged by the time constant `tau`, and the decay from the start.

    Parameters
    ----------
    context : Context
        Its log has all rows of the run, interpolated linearly.
    driver : str
    tau : float
        s.

    Returns
    -------
    late, fading : ndarray, shape (n,)
        NaN where the driver or the time is unknown. `late` starts in equilibrium with the first
        value.
    """
    time, value = context.log_of(driver)
    at, out = context.get('time'), np.full((2, len(context)), np.nan)
    if at is None or not len(time):
        return out
    steps = np.diff(time)
    slope, left = np.diff(value) / steps, np.exp(-steps / tau)
    late, behind = np.empty(len(time)), 0.0  # difference from the log
    late[0] = value[0]
    for i in range(len(steps)):
        behind = slope[i] * tau + (behind - slope[i] * tau) * left[i]
        late[i + 1] = value[i + 1] - behind
    known = np.isfinite(at)
    if context.get(driver) is not None:
        known &= np.isfinite(context.get(driver))
    place = np.minimum(np.searchsorted(time, at[known]), len(time) - 1)
    out[0, known] = late[place]
    out[1, known] = np.exp(-(at[known] - time[0]) / tau)
    return out


@form
def _lagged(of, tau, driver='temperature', origin=0.0, within=None, start=True, mount=USUAL):
    """A term x the lagged driver; with ``start`` the temperature before the log is fitted, too."""
    what, axes, words = moving(of, KINDS[mount])
    term = terms_of(mount)[KINDS[mount].named(of)]

    def columns(c):
        late, fading = lagged(c, driver, tau)
        if within is not None:
            late = np.clip(late, *within)
        x, y = term.of(c.trig)
        return [(x * u, y * u) for u in ((late - origin, fading) if start else (late - origin,))]

    def wording(amount):
        text = f'{words} follows {the(driver)} late: {arcsec(abs(amount.values[0]))} a degree'
        if amount.span is not None:
            range_ = amount.span[1] - amount.span[0]
            text += f', {arcsec(abs(amount.values[0]) * range_)} for {range_:.1f} °C'
        return text

    return Effect(f'{what.partition(" of the ")[0].replace(" ", "_")}_with_{driver}_late',
                  f'{what} follows {driver_word(driver)} with a lag',
                  f"{term.name} x q, q' = (T - q) / tau" + (', exp(-t / tau)' if start else ''),
                  driver, axes, ('slope', 'start') if start else ('slope',), columns, wording,
                  'mirror, cell, truss and pier, slow to cool; open the dome long '
                  'before the first star',
                  f'a slow change with {the(driver)}, late', '', 'arcsec/K',
                  requires=('time', driver), scan=f'lag_{of}', searched=('tau',), share='scans',
                  # a lag changes the curve little: it does not count as a free parameter
                  scanned=0)


@form
def _secondary(driver='temperature', origin=0.0, scale=1.0, within=None, mount=USUAL):
    """Temperature-dependent hang of a secondary mirror: temperature x (cos E, sin E)."""
    def columns(c):
        u, zenith = progress(c, driver, origin, scale, within), c.trig.zenith
        return [c.trig.lifted(u * zenith.cos_el), c.trig.lifted(u * zenith.sin_el)]

    def wording(amount):
        range_ = 1.0 if amount.span is None else (amount.span[1] - amount.span[0]) / scale
        return (f'The secondary mirror hangs otherwise as the temperature changes: up to '
                f'{arcsec(amount.size * range_)} between horizon and zenith over this run')

    return Effect(f'secondary_with_{driver}',
                  f'secondary mirror tilts or shifts with {driver_word(driver)}, by its height',
                  'cos E x T, sin E x T toward the zenith', driver,
                  'el' if KINDS[mount].vertical else 'both', ('cos', 'sin'), columns, wording,
                  'the cell, spider and hexapod or focuser of the secondary mirror: screws that '
                  'came loose, its table of corrections',
                  f'a change of flexure with {the(driver)}', '',
                  'arcsec/K' if scale == 1.0 else f'arcsec/({scale:.4g})', requires=(driver,))


def propose(context, lacking, own):
    """For the temperature, and for columns that are temperatures or declared as causes."""
    yield from _lags(context)
    yield offer('secondary', 'secondary mirror with temperature', context, 'temperature',
                lambda v: [effect('secondary', **about('temperature', 1.0, v))])
    for name in context.extra():
        if _WARM.search(name.lower()) or name in context.drivers:
            # zeros and collimation of any column: see `columns.propose`
            yield offer('drift', name, context, name, lambda v, name=name: [
                *(effect('drift', of=of, **about(name, float(np.std(v)), v))
                  for of in ('TF', 'tilt')),
                effect('secondary', **about(name, float(np.std(v)), v))])


def _lags(context):
    """Lags that the run can distinguish from the temperature itself."""
    what, driver = 'late temperature', 'temperature'
    values, reason = context.span(driver)
    at = context.get('time')
    if reason or at is None:
        yield Offer('lagged', [], what, reason or 'the time is not known')
        return
    time, log = context.log_of(driver)
    rows = np.sort(at[np.isfinite(at)])
    usual, out = float(np.median(np.diff(rows))), []
    given = {k: v for k, v in about(driver, 1.0, values).items() if k != 'scale'}
    for tau in LAGS:
        if not _STEPS * usual <= tau <= np.ptp(rows):
            continue
        both = lagged(context, driver, tau)
        known = np.isfinite(both[0])
        plain = np.column_stack([np.ones(known.sum()), context.get(driver)[known]])
        rest = both[:, known].T - plain @ np.linalg.lstsq(plain, both[:, known].T, rcond=None)[0]
        bends, fades = rest.std(axis=0) > _BENDS * np.array([log.std(), both[1, known].std()])
        # start in equilibrium; and out of it, unless the start is long past
        starts = [start for start, offered in (
            (False, bends), (True, (bends or fades) and rows[0] - time[0] < BEFORE * tau))
            if offered]
        out += [effect('lagged', of=of, tau=tau, start=start, **given)
                for of in _LATE for start in starts]
    yield Offer('lagged', out, what, None if out else
                'the temperature goes too straight in time to show a lag')
