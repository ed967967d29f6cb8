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

"""Which rows are used for fits, and which are held out to validate them."""

from typing import NamedTuple

import numpy as np

from msg_tools.units import ARCSEC, wrap
from pointing_model.mounts import mount_wording
from pointing_model.runs.run import PointingRun
from pointing_model.zero import MARK, NO_ZERO, is_for_zero, is_marked

from .distrust import distrusted
from .estimation.robust import GROSS

#: reason to exclude a row whose direction has no encoder angles
UNREACHABLE = 'the model cannot point there'
#: the same for a fitted model
BEYOND_COLLIMATION = 'nearer to the zenith than the collimation lets the mount look'
#: reason for a row without weight in the robust fit of a diagnosis
OUTLIER = (f'outlier: more than {GROSS:g} times the noise away from the model, and not by '
           'whole lines of the encoder')
#: rad: a smaller sigma was not measured, and its weight would overflow
LEAST_SIGMA = 1e-12 * ARCSEC
#: floor of a sigma, over the median of its axis; largest part of the rows below it to be raised:
#: more are a better instrument
_FLOOR, _LONE = 0.2, 0.1


def is_kept_out(rows):
    """Mask of the held-out (validation) rows: those whose column ``check`` is not 0.

    The observer marks each row when it is taken, so that nothing is guessed from the plan.

    Parameters
    ----------
    rows : PointingRun

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    return np.asarray(rows.get('check', 0.0), dtype=float) != 0.0


def for_fitting(rows):
    """Rows for fits and selections: without satellites, held-out rows and falsified rows.

    Parameters
    ----------
    rows : PointingRun
        With column `star`; negative: a satellite, which is for checks only. In the order in which
        they were taken, to find rows falsified by an instrument, see `distrust`.
    """
    return rows.select((rows['star'] >= 0) & ~is_kept_out(rows) & ~distrusted(rows))


def by_power_on(rows):
    """Rows of each power-on, dict of float to PointingRun, in ascending order of the numbers."""
    order = np.argsort(rows['run'], kind='stable')
    numbers, first = np.unique(rows['run'][order], return_index=True)
    return {float(number): rows.select(part)
            for number, part in zip(numbers, np.split(order, first[1:]))}


def zero_exposures_by_power_on(rows):
    """Yield number and exposures for a zero of each power-on that has some, a PointingRun.

    Without falsified rows.
    """
    for number, part in by_power_on(rows.select(is_for_zero(rows) & ~distrusted(rows))).items():
        yield int(number), part


def counts(rows):
    """Numbers of stars and exposures for zeros: ``stars``, ``polaris``, and ``for_zero`` if any."""
    marked = int(np.count_nonzero(is_marked(rows)))
    stars = int(np.count_nonzero(~is_for_zero(rows)))
    out = {'stars': stars, 'polaris': len(rows) - stars - marked}
    return {**out, 'for_zero': marked} if marked else out


def with_marks(rows):
    """The rows with all columns of marks: when rows are joined, only common columns remain."""
    missing = [name for name in ('check', MARK) if name not in rows]
    if not missing:
        return rows
    return PointingRun({**rows.columns, **{name: np.zeros(len(rows)) for name in missing}},
                       rows.meta)


def stars_without_zeros(rows, zeros, site, follows):
    """Rows for a diagnosis: stars available to fits, with the zeros subtracted.

    Parameters
    ----------
    rows, zeros, site
        See `without_zeros`.
    follows : Following
        Which zeros follow the absolute encoder.
    """
    seen = for_fitting(follows.corrected(rows))
    return without_zeros(seen.select(~is_for_zero(seen)), zeros, site)


def without_zeros(rows, zeros, site=None):
    """The rows with the zeros subtracted, for `diagnose`.

    Parameters
    ----------
    rows : PointingRun
        With columns `star` and `run`.
    zeros : Zeros
        A power-on without a zero has that of the one before.
    site : dict, optional
        ``latitude``, ``longitude``, rad.
    """
    columns = dict(rows.columns)
    az, el = zeros.carried(np.unique(rows['run'])).row_angles(rows)
    # `az_raw` and `el_raw` are plain readings: no zero subtracted, no miss of the star added
    for axis, zero, factor, miss in (('az', az, np.cos(rows['el']), 'miss_x'),
                                     ('el', el, 1.0, 'miss_y')):
        if f'{axis}_raw' not in columns:
            columns[f'{axis}_raw'] = rows[f'{axis}_enc'] - np.nan_to_num(rows.get(miss)) / factor
        columns[f'{axis}_enc'] = rows[f'{axis}_enc'] - zero
    if np.all(columns['star'] == np.floor(columns['star'])):
        columns['star'] = columns['star'].astype(np.int64)
    return PointingRun(columns, {**rows.meta, **({'site': site} if site else {})})


class Usable(NamedTuple):
    """Rows that a fit can use, and why others are excluded (see `usable`).

    Attributes
    ----------
    rows : ndarray of int, shape (m,)
        Their indices in the run.
    az, el, az_enc, el_enc : ndarray, shape (m,)
        Catalogue place, and encoder angles less their zero, radians; the first encoder angle
        is within half a turn of the place.
    sigmas : ndarray, shape (2m,), or None
        1-sigma noise of x, then y, radians.
    excluded : list of dict
        ``row`` and ``reason`` of the others.
    raised : list of dict
        ``row``, ``axis`` (x or y), ``given`` and ``taken`` of sigmas that were raised because they
        are far below the others, radians.
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
        """With the sigmas of x and y multiplied by `Estimate.ratios` above 1."""
        return self if self.sigmas is None else self._replace(sigmas=self.sigmas * np.repeat(
            np.maximum(ratios, 1.0), len(self.rows)))

    @property
    def mild_sigmas(self):
        """`mild_sigmas` of `sigmas`."""
        return mild_sigmas(self.sigmas)

    def only(self, good, reason):
        """Keep rows where `good`, shape (m,), is true; exclude the others with the reason."""
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
        ``sigma_x`` and ``sigma_y`` are used if both exist and are not all unknown.
    encoder : {'enc', 'abs'}
    zero : PowerOnZero or Zeros
        Subtracted from the encoder's angles.

    Returns
    -------
    Usable

    Raises
    ------
    ValueError
        Unknown encoder, or one that the run lacks; a run without a zero.
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
    """Sigmas of an axis, with those far below the others raised to a fifth of the median.

    A row with so small a sigma would dominate the fit, and its error would go into the result in
    full.

    Parameters
    ----------
    sigmas : ndarray, shape (n,)
    lone : bool
        Raise them only if they are one row, or at most the part `_LONE` of all: more are another
        instrument.
    """
    least = _FLOOR * float(np.median(sigmas)) if len(sigmas) else 0.0
    below = sigmas < least
    count = int(np.count_nonzero(below))
    if not count or lone and count > max(1, _LONE * len(sigmas)):
        return sigmas
    return np.where(below, least, sigmas)


def mild_sigmas(sigmas):
    """Sigmas, shape (2n,), to decide which coefficients are determined; None where none are given.

    All far below the others are raised, however many: otherwise a few rows of high weight could
    make columns look equal that differ in all other rows.
    """
    if sigmas is None:
        return None
    return np.hstack([floored(one, False) for one in sigmas.reshape(2, -1)])


def check_mount(mount, others):
    """Raise ValueError if observations are of a different mount than other inputs.

    Parameters
    ----------
    mount : Mount
    others : dict of str to (Mount or None)
        Mounts by the name of the input, in words; None: not known.
    """
    for what, other in others.items():
        if other is not None and not mount.agrees(other):
            raise ValueError(f'an observation of another mount ({mount_wording(mount)}) than '
                             f'{what} ({mount_wording(other)})')
