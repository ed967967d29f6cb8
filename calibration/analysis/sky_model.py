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

"""Do the errors of a German mount belong to its parts, or to a model applied on the sky?

Errors of mount parts go through the pole with the mount: collimation, non-perpendicularity and the
zero of the declination axis change sign on the sky on the other side of the pier. A program that
corrects hour angle and declination *before* it works out the side applies the same correction on
both: its terms do not change sign. A mount driven through such a program, or a simulator built that
way, shows errors of the second kind.

Both are models with the same number of coefficients, fitted to the same rows (`Mount.errors`) and
compared by cross-validation. The better one is set in the mount of the run (`settled`), for all
later fits, tests and publications.
"""

from dataclasses import dataclass

import numpy as np

from msg_tools.units import ARCSEC, wrap
from pointing_model.mounts import OF_MOUNT, ON_SKY, Mount, is_beyond, through_pole
from pointing_model.rms import rms
from pointing_model.runs.run import PointingRun
from pointing_model.zero import is_for_zero

from .term_fit import fit_terms

#: significance level for deciding between the two models
CHANCE = 0.01
#: cross-validation folds
FOLDS = 10
#: fewest rows on each side of the pier
FEWEST = 3
_LIMIT = 3.0  # largest radial residual in the loss, in units of the noise of the better fit


def with_errors(run, errors):
    """The run with another value of `Mount.errors`.

    Parameters
    ----------
    run : PointingRun
        Run of a German mount.
    errors : {'mount', 'sky'}
    """
    return PointingRun(run.columns, {**run.meta, 'mount': run.mount.with_errors(errors)})


def settled(run, names=None, *, encoder='enc', robust=True):
    """The run with the better kind of errors if its rows decide; otherwise unchanged.

    Parameters
    ----------
    run, names, encoder, robust
        See `origin_of_errors`.

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
    """Runs of one mount, with the kind of errors decided by the longest run of the first group.

    Parameters
    ----------
    *groups : sequence of PointingRun, or None
        The first is not empty.
    encoder : {'enc', 'abs'}

    Returns
    -------
    groups : tuple
        In the form given.
    origin : Origin or None
        None if the kind of errors is undecided or unchanged.
    """
    origin = origin_of_errors(max(groups[0], key=len), encoder=encoder)
    if origin is None or origin.holds in ('', groups[0][0].mount.errors):
        return groups, None
    return tuple([with_errors(run, origin.holds) for run in each] if each else each
                 for each in groups), origin


@dataclass(frozen=True)
class Origin:
    """Comparison of the two kinds of errors by cross-validation.

    Attributes
    ----------
    holds : {'mount', 'sky', ''}
        The better one; '' if the rows do not decide.
    chance : float
        Two-sided p of the difference, by Wilcoxon's signed-rank test of the radial errors of
        held-out rows. It assumes no distribution, and an outlier counts as one row.
    left_out : dict of str to float
        Cross-validated radial RMS of ``mount`` and ``sky``, rad.
    fits : dict of str to FitResult
        Fits of both to all rows; that of ``sky`` is to the folded run.
    rows : int
        Number of rows compared, without those that the better fit rejects.
    beyond : int
        Number of these observed through the pole.
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
    """Compare both kinds of errors, if the run allows it.

    Parameters
    ----------
    run : PointingRun
    names : sequence of str, optional
        Terms to fit; by default the mount's physical ones.
    encoder : {'enc', 'abs'}
    robust : bool
        See `fit.fit_terms`.

    Returns
    -------
    Origin or None
        None for another mount than a German one, only one side, no term whose sign changes with
        the side, or too few rows.
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
    except ValueError:  # too few rows for the terms
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
    """Rows that the better of some robust fits does not reject; outliers test neither model.

    Outliers are, for example, rows with the wrong side of the pier. The better fit has the smaller
    truncated sum of squares.
    """
    limit = _LIMIT * min(fit.rms_arcsec(rejected=False).radial for fit in fits) * ARCSEC
    squares = [np.square(fit.residual_x) + np.square(fit.residual_y) for fit in fits]
    losses = [np.nansum(np.minimum(square, limit**2)) for square in squares]
    return fits[int(np.argmin(losses))].weights > 0.0


def origin_of_night(rows):
    """`origin_of_errors` of the stars of the power-on with most rows.

    Only of one, for each power-on has its own zero.

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
    """The run as of a mount that never goes through the pole: angles folded back to the sky."""
    beyond = is_beyond(run['el'])
    pairs = [through_pole(run[f'az{of}'], run[f'el{of}'], beyond) for of in ('', f'_{encoder}')]
    columns = dict(zip(('az', 'el', f'az_{encoder}', f'el_{encoder}'), sum(pairs, ())))
    return PointingRun({**run.columns, **columns},
                       {**run.meta, 'mount': Mount('equatorial', run.mount.frame)})


def _long_runs(numbers):
    """Runs with at least `FEWEST` rows, more than their zeros need."""
    numbers, counts = np.unique(numbers, return_counts=True)
    return numbers[counts >= FEWEST]


def _left_out(run, names, encoder, robust, beyond, several):
    """Cross-validated errors of each row on the sky, (x, y), rad; folds have rows of both sides.

    With several runs each has its own zero, and no run is in one fold alone.
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
