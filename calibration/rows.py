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

"""Which rows a fit may see, and which are there to validate it."""

from typing import NamedTuple

import numpy as np

from msg_tools.units import ARCSEC, wrap
from pointing_model.mounts import mount_wording
from pointing_model.runs.run import PointingRun
from pointing_model.zero import MARK, NO_ZERO, is_for_zero, is_marked

from .distrust import distrusted
from .estimation.robust import GROSS

#: why a row is left out that no encoder angles belong to
UNREACHABLE = 'the model cannot point there'
#: the same of a fitted model
BEYOND_COLLIMATION = 'nearer to the zenith than the collimation lets the mount look'
#: of one that the robust fit of a diagnosis gives no weight
OUTLIER = (f'outlier: more than {GROSS:g} times the noise away from the model, and not by '
           'whole lines of the encoder')
#: rad: a sigma below was not measured, and its weight is no number
LEAST_SIGMA = 1e-12 * ARCSEC
#: of the median sigma of an axis, that of a row which claims to be far better; part of the rows
#: that may do so and are no instrument of their own
_FLOOR, _LONE = 0.2, 0.1


def is_kept_out(rows):
    """Mask of the rows to judge by: those whose column ``check`` is not 0.

    The observer marks a row when it takes it, so that nothing has to be guessed from the plan.

    Parameters
    ----------
    rows : PointingRun

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    return np.asarray(rows.get('check', 0.0), dtype=float) != 0.0


def for_fitting(rows):
    """The rows that fits and choices may see: no satellites, nothing kept out, no lies.

    Parameters
    ----------
    rows : PointingRun
        With column `star`; negative: a satellite, which is for checks only. In the order in which
        they were taken: what an instrument falsified is left out, see `distrust`.
    """
    return rows.select((rows['star'] >= 0) & ~is_kept_out(rows) & ~distrusted(rows))


def by_power_on(rows):
    """Rows of each power-on, dict of float to PointingRun, in ascending order of the numbers."""
    order = np.argsort(rows['run'], kind='stable')
    numbers, first = np.unique(rows['run'][order], return_index=True)
    return {float(number): rows.select(part)
            for number, part in zip(numbers, np.split(order, first[1:]))}


def zero_exposures_by_power_on(rows):
    """Number and exposures for a zero, a PointingRun, of each power-on with some; no lies."""
    for number, part in by_power_on(rows.select(is_for_zero(rows) & ~distrusted(rows))).items():
        yield int(number), part


def counts(rows):
    """Numbers of stars and exposures for zeros: ``stars``, ``polaris``, and ``for_zero`` if any."""
    marked = int(np.count_nonzero(is_marked(rows)))
    stars = int(np.count_nonzero(~is_for_zero(rows)))
    out = {'stars': stars, 'polaris': len(rows) - stars - marked}
    return {**out, 'for_zero': marked} if marked else out


def with_marks(rows):
    """The rows with the columns of marks: joined with others, they must not take theirs away."""
    missing = [name for name in ('check', MARK) if name not in rows]
    if not missing:
        return rows
    return PointingRun({**rows.columns, **{name: np.zeros(len(rows)) for name in missing}},
                       rows.meta)


def stars_without_zeros(rows, zeros, site, follows):
    """The rows that are diagnosed: stars that fits may see, with the zeros taken off.

    Parameters
    ----------
    rows, zeros, site
        As of `without_zeros`.
    follows : Following
        Which zeros follow the absolute encoder.
    """
    seen = for_fitting(follows.corrected(rows))
    return without_zeros(seen.select(~is_for_zero(seen)), zeros, site)


def without_zeros(rows, zeros, site=None):
    """The rows with the zeros taken off, as `diagnose` wants them.

    Parameters
    ----------
    rows : PointingRun
        With columns `star` and `run`.
    zeros : Zeros
        A power-on without one has that before it.
    site : dict, optional
        ``latitude``, ``longitude``, rad.
    """
    columns = dict(rows.columns)
    az, el = zeros.carried(np.unique(rows['run'])).row_angles(rows)
    # readings are what the encoders read: the zero and the star's place are no part of them
    for axis, zero, factor, miss in (('az', az, np.cos(rows['el']), 'miss_x'),
                                     ('el', el, 1.0, 'miss_y')):
        if f'{axis}_raw' not in columns:
            columns[f'{axis}_raw'] = rows[f'{axis}_enc'] - np.nan_to_num(rows.get(miss)) / factor
        columns[f'{axis}_enc'] = rows[f'{axis}_enc'] - zero
    if np.all(columns['star'] == np.floor(columns['star'])):
        columns['star'] = columns['star'].astype(np.int64)
    return PointingRun(columns, {**rows.meta, **({'site': site} if site else {})})


class Usable(NamedTuple):
    """Rows that a fit can use, and why it cannot use the others (see `usable`).

    Attributes
    ----------
    rows : ndarray of int, shape (m,)
        Their places in the run.
    az, el, az_enc, el_enc : ndarray, shape (m,)
        Catalogue place, and encoder angles without their zero, radians; the first encoder angle
        is within half a turn of the place.
    sigmas : ndarray, shape (2m,), or None
        1-sigma noise of x, then y, radians.
    excluded : list of dict
        ``row`` and ``reason`` of the others.
    raised : list of dict
        ``row``, ``axis`` (x or y), ``given`` and ``taken`` of sigmas that are far below the
        others', radians.
    """

    rows: np.ndarray
    az: np.ndarray
    el: np.ndarray
    az_enc: np.ndarray
    el_enc: np.ndarray
    sigmas: np.ndarray | None
    excluded: list
    raised: list = ()

    def with_ratios(self, ratios):
        """With the sigmas of x and y multiplied by what is above 1, as of `Estimate.ratios`."""
        return self if self.sigmas is None else self._replace(sigmas=self.sigmas * np.repeat(
            np.maximum(ratios, 1.0), len(self.rows)))

    @property
    def mild_sigmas(self):
        """`mild_sigmas` of these."""
        return mild_sigmas(self.sigmas)

    def only(self, good, reason):
        """Those where `good`, shape (m,), holds; the others are excluded with the reason."""
        if good.all():
            return self
        lost = [{'row': int(i), 'reason': reason} for i in self.rows[~good]]
        sigmas = None if self.sigmas is None else self.sigmas[np.concatenate((good, good))]
        return Usable(*(v[good] for v in self[:5]), sigmas,
                      sorted(self.excluded + lost, key=lambda e: e['row']), self.raised)


def usable(run, encoder='enc', zero=NO_ZERO):
    """Finite rows with their sigmas.

    Parameters
    ----------
    run : PointingRun
        ``sigma_x`` and ``sigma_y`` are taken if both are there and not all unknown.
    encoder : {'enc', 'abs'}
    zero : PowerOnZero or Zeros
        To subtract from the encoder's angles.

    Returns
    -------
    Usable

    Raises
    ------
    ValueError
        Unknown encoder, or the run does not have it; a run without a zero.
    """
    if encoder not in ('enc', 'abs'):
        raise ValueError(f'unknown encoder {encoder!r}; take enc or abs')
    for name in (f'az_{encoder}', f'el_{encoder}'):
        if name not in run:
            raise ValueError(f'pointing run without column {name}; fit the other encoder')
    columns = {name: np.asarray(run[name], float)
               for name in ('az', 'el', f'az_{encoder}', f'el_{encoder}')}
    for name, angle in zip((f'az_{encoder}', f'el_{encoder}'), zero.row_angles(run)):
        if np.ndim(angle) or angle:
            columns[name] = columns[name] - angle
    sigmas = None
    if 'sigma_x' in run and 'sigma_y' in run:
        sigmas = [np.asarray(run[name], float) for name in ('sigma_x', 'sigma_y')]
        if all(np.isnan(s).all() for s in sigmas):
            sigmas = None
    good = np.isfinite(list(columns.values())).all(axis=0)
    for value in sigmas or ():
        good &= np.isfinite(value) & (value > LEAST_SIGMA)
    kept, excluded, raised = np.flatnonzero(good), [], []
    for row in np.flatnonzero(~good):
        bad = [name for name, v in columns.items() if not np.isfinite(v[row])]
        reason = f'{", ".join(bad)} not finite' if bad else 'sigma not finite and positive'
        excluded.append({'row': int(row), 'reason': reason})
    if sigmas is not None:
        for axis, given in enumerate(sigmas):
            given, taken = given[good], floored(given[good])
            raised += [{'row': int(kept[i]), 'axis': 'xy'[axis], 'given': float(given[i]),
                        'taken': float(taken[i])} for i in np.flatnonzero(taken != given)]
            sigmas[axis] = taken
        sigmas = np.concatenate(sigmas)
    az, el, az_enc, el_enc = (v[good] for v in columns.values())
    az_enc = az + wrap(az_enc - az)
    if not run.mount.vertical:  # either side of the half turn
        el_enc = el + wrap(el_enc - el)
    return Usable(kept, az, el, az_enc, el_enc, sigmas, excluded, raised)


def floored(sigmas, lone=True):
    """Sigmas of an axis, those far below the others at a fifth of the median.

    A row that claims to be so much better than the others decides alone what it says, and what is
    wrong with it is in the result in full.

    Parameters
    ----------
    sigmas : ndarray, shape (n,)
    lone : bool
        Only where they are one row, or one of so many (`_LONE`): more are another instrument.
    """
    least = _FLOOR * float(np.median(sigmas)) if len(sigmas) else 0.0
    below = sigmas < least
    count = int(np.count_nonzero(below))
    if not count or lone and count > max(1, _LONE * len(sigmas)):
        return sigmas
    return np.where(below, least, sigmas)


def mild_sigmas(sigmas):
    """Sigmas, shape (2n,), by which is decided what rows determine; None where none were given.

    None of them is far below the others, however many are: a few rows do not make columns equal
    in which all others differ.
    """
    if sigmas is None:
        return None
    return np.hstack([floored(one, False) for one in sigmas.reshape(2, -1)])


def check_mount(mount, others):
    """ValueError where observations are of another mount than what they are to go with.

    Parameters
    ----------
    mount : Mount
    others : dict of str to (Mount or None)
        By what they are of, in words; None: not known.
    """
    for what, other in others.items():
        if other is not None and not mount.agrees(other):
            raise ValueError(f'an observation of another mount ({mount_wording(mount)}) than '
                             f'{what} ({mount_wording(other)})')
