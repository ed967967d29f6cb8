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

"""Whether the errors of a German mount are those of its parts, or of a model applied on the sky.

A part of a mount goes through the pole with it: collimation, non-perpendicularity and the zero of
the declination axis are reversed on the sky on the other side of the pier. A program that corrects
hour angle and declination *before* it works out the side applies the same number on both: its
terms do not change their sign. A mount that is driven through such a program, or a simulator that
is made so, shows errors of the second kind.

Both are models of the same number of coefficients, fitted to the same rows (`Mount.errors`); they
are tested on rows left out. What holds is the mount of the run from then on (`settled`), so that
all that is fitted, tested and published later has it.
"""

from dataclasses import dataclass

import numpy as np

from msg_tools.units import ARCSEC, wrap
from pointing_model.mounts import OF_MOUNT, ON_SKY, Mount, is_beyond, through_pole
from pointing_model.rms import rms
from pointing_model.runs.run import PointingRun
from pointing_model.zero import is_for_zero

from .term_fit import fit_terms

#: chance that rows of two models that predict alike differ as much, below which one is said to hold
CHANCE = 0.01
#: rows left out together are one of so many parts
FOLDS = 10
#: fewer rows of a side say nothing of it
FEWEST = 3
_LIMIT = 3.0  # times the noise of the better fit, radial, that a row adds to its loss


def with_errors(run, errors):
    """The run, of a mount whose errors are of its parts or act on the sky.

    Parameters
    ----------
    run : PointingRun
        Of a German mount.
    errors : {'mount', 'sky'}
    """
    return PointingRun(run.columns, {**run.meta, 'mount': run.mount.with_errors(errors)})


def settled(run, names=None, *, encoder='enc', robust=True):
    """The run with the errors that hold, where it can tell; else as it is.

    Parameters
    ----------
    run, names, encoder, robust
        As of `origin_of_errors`.

    Returns
    -------
    run : PointingRun
    origin : Origin or None
    """
    origin = origin_of_errors(run, names, encoder=encoder, robust=robust)
    if origin is not None and origin.holds:
        run = with_errors(run, origin.holds)
    return run, origin


def settled_together(*groups, encoder='enc'):
    """Runs of one mount, with the errors that hold by the longest of the first group.

    Parameters
    ----------
    *groups : sequence of PointingRun, or None
        The first is not empty.
    encoder : {'enc', 'abs'}

    Returns
    -------
    groups : tuple
        As they were given.
    origin : Origin or None
        Where the errors that hold are others than the runs had; else None.
    """
    origin = origin_of_errors(max(groups[0], key=len), encoder=encoder)
    if origin is None or origin.holds in ('', groups[0][0].mount.errors):
        return groups, None
    return tuple([with_errors(run, origin.holds) for run in each] if each else each
                 for each in groups), origin


@dataclass(frozen=True)
class Origin:
    """Which of the two leaves less on rows left out.

    Attributes
    ----------
    holds : {'mount', 'sky', ''}
        '' where the rows do not decide.
    chance : float
        Of the difference, two-sided, by Wilcoxon's signed-rank test of the radial errors of each
        row left out. It asks no distribution of them, and one wild row counts as one row.
    left_out : dict of str to float
        Radial RMS of rows left out of ``mount`` and ``sky``, rad.
    fits : dict of str to FitResult
        To all rows, of both; that of ``sky`` is to the folded run.
    rows : int
        Compared: without those that the better fit rejects.
    beyond : int
        Of them, through the pole.
    """

    holds: str
    chance: float
    left_out: dict
    fits: dict
    rows: int
    beyond: int

    def document(self):
        """JSON-ready."""
        return {
            'holds': self.holds or None, 'chance': self.chance, 'rows': self.rows,
            'rows_through_the_pole': self.beyond,
            'left_out_radial_arcsec': {name: value / ARCSEC
                                       for name, value in self.left_out.items()},
            'terms': {name: fit.term_rows() for name, fit in self.fits.items()}}


def origin_of_errors(run, names=None, *, encoder='enc', robust=True):
    """Compare both, where the run can tell.

    Parameters
    ----------
    run : PointingRun
    names : sequence of str, optional
        Terms to fit; by default the mount's physical ones.
    encoder : {'enc', 'abs'}
    robust : bool
        As of `fit.fit_terms`.

    Returns
    -------
    Origin or None
        None where nothing can be reported: another mount than a German one, one side alone, no term
        whose sign changes with the side, or too few rows.
    """
    names = run.mount.names.physical if names is None else tuple(names)
    if not run.mount.two_sided or not {'ID', 'CH', 'NP'} & set(names):
        return None
    good = np.ones(len(run), bool)
    for name in ('az', 'el', f'az_{encoder}', f'el_{encoder}'):
        good &= np.isfinite(run[name])
    run = run.select(good)
    beyond = is_beyond(run['el'])
    if min(beyond.sum(), (~beyond).sum()) < FEWEST or 2 * len(run) * (FOLDS - 1) < (
            2 * len(names) * FOLDS):
        return None
    several = 'run' in run and np.ptp(run['run']) > 0.0  # each has its own zero
    if several:
        run = run.select(np.isin(run['run'], _long_runs(run['run'])))
        beyond = is_beyond(run['el'])
    runs = {OF_MOUNT: with_errors(run, OF_MOUNT), ON_SKY: _folded(run, encoder)}
    try:
        fits = {name: fit_terms(rows, names, encoder=encoder, robust=robust, run_zeros=several)
                for name, rows in runs.items()}
        good = _described(list(fits.values()))
        if min((beyond & good).sum(), (~beyond & good).sum()) < FEWEST:
            return None
        errors = {name: _left_out(rows.select(good), names, encoder, robust, beyond[good], several)
                  for name, rows in runs.items()}
    except ValueError:  # what is left has too few rows for the terms
        return None
    lengths = {name: np.hypot(*both) for name, both in errors.items()}
    left_out = {name: float(rms(*both)) for name, both in errors.items()}
    difference = lengths[OF_MOUNT] - lengths[ON_SKY]
    chance = 1.0
    if np.abs(difference).max() > 1e-6 * ARCSEC:
        from scipy.stats import wilcoxon  # half a second
        chance = float(wilcoxon(lengths[OF_MOUNT], lengths[ON_SKY]).pvalue)
    holds = ''
    if chance < CHANCE:
        holds = ON_SKY if np.median(difference) > 0.0 else OF_MOUNT
    return Origin(holds, chance, left_out, fits, int(good.sum()), int(beyond[good].sum()))


def _described(fits):
    """Rows that the better of some robust fits does not reject: what else there is judges none.

    Such as rows with the side of the pier that the mount had before. The better one has less of
    a loss that no row adds more than a limit to.
    """
    limit = _LIMIT * min(fit.rms_arcsec(rejected=False).radial for fit in fits) * ARCSEC
    squares = [np.square(fit.residual_x) + np.square(fit.residual_y) for fit in fits]
    losses = [np.nansum(np.minimum(square, limit**2)) for square in squares]
    return fits[int(np.argmin(losses))].weights > 0.0


def origin_of_night(rows):
    """As `origin_of_errors`, of the stars of the power-on that has most.

    Each power-on has its own zero.

    Parameters
    ----------
    rows : PointingRun
        With a column `run`.
    """
    stars = rows.select(~is_for_zero(rows))
    numbers, counts = np.unique(stars['run'], return_counts=True)
    if not len(numbers):
        return None
    return origin_of_errors(stars.select(stars['run'] == numbers[np.argmax(counts)]))


def _folded(run, encoder):
    """Rows of a mount that never goes through the pole, at the angles folded back to the sky."""
    beyond = is_beyond(run['el'])
    pairs = [through_pole(run[f'az{of}'], run[f'el{of}'], beyond) for of in ('', f'_{encoder}')]
    columns = dict(zip(('az', 'el', f'az_{encoder}', f'el_{encoder}'), sum(pairs, ())))
    return PointingRun({**run.columns, **columns},
                       {**run.meta, 'mount': Mount('equatorial', run.mount.frame)})


def _long_runs(numbers):
    """Those with rows beyond what their zeros take."""
    numbers, counts = np.unique(numbers, return_counts=True)
    return numbers[counts >= FEWEST]


def _left_out(run, names, encoder, robust, beyond, several):
    """Errors on the sky of each row by a fit without it, (x, y), rad; parts have both sides.

    Of several runs each has its own zero; none lies in one part alone.
    """
    number = run['run'] if several else np.zeros(len(run))
    order = np.lexsort((beyond, number))
    part = np.empty(len(run), int)
    part[order] = np.arange(len(run)) % min(FOLDS, len(run))
    out = np.empty((2, len(run)))
    for at in np.unique(part):
        out_of = part == at
        fitted = fit_terms(run.select(~out_of), names, encoder=encoder, robust=robust,
                           run_zeros=several)
        rows = run.select(out_of)
        if several:
            zero = fitted.zeros.row_angles(rows)
            for name, angle in zip((f'az_{encoder}', f'el_{encoder}'), zero):
                rows.columns[name] = rows[name] - angle
        out[:, out_of] = np.subtract(rows.offsets(encoder),
                                     fitted.model.offsets(rows['az'], rows['el']))
    return np.array([out[0], wrap(out[1])])
