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

"""The result of a fit: the model, its errors, and what the stars did not determine."""

from dataclasses import dataclass, replace

import numpy as np

from calibration.estimation.row_influence import Linearisation
from msg_tools.units import ARCSEC
from pointing_model.model import OPEN, PointingModel
from pointing_model.model_document import coefficient_row
from pointing_model.mounts import rows_by_side
from pointing_model.rms import rms, rms_arcsec
from pointing_model.zero import NO_ZERO, PowerOnZero, Zeros

from ..estimation.few_rows import FEW
from ..rows import BEYOND_COLLIMATION
from .finding import Finding

#: a prediction that an undetermined direction changes by more than this times its RMS at the stars
#: counts as undetermined
_BEYOND = 10.0
_NOTHING = 1e-9  # component of a direction that is rounding, over the largest


@dataclass(frozen=True)
class FitResult:
    """A fitted model and its quality.

    Attributes
    ----------
    model : PointingModel
        The fitted model (including a held model).
    names : tuple of str, length k
        Names of the fitted coefficients.
    coefficients : ndarray, shape (k,)
        Radians; for a term that is also in the held model, the amount added.
    covariance : ndarray, shape (k, k)
        Radians^2, without the directions in `dropped`: values of `undetermined` coefficients
        depend on those held at zero, and only predictions among the observed stars are meaningful.
    covariance_from : {'given sigmas', 'multiplied sigmas', 'measured scatter'}
        Source of the scale of the covariance.
    scatter : tuple of float
        Noise of x and y, radians (each axis with its own degrees of freedom).
    rank : int
    singular_values : ndarray, shape (k,)
        Singular values of the first-order design, weighted by the sigmas, with columns of unit
        length, descending.
    dropped : list of dict
        Directions below `rcond`: ``text`` with the main terms, ``direction``,
        ``relative_singular_value``.
    residual_x, residual_y : ndarray, shape (n,)
        Residual of each row on the sky, radians; NaN in excluded rows.
    weights : ndarray, shape (n,)
        Robust weight of each row, 0 (rejected or excluded) to 1.
    excluded : list of dict
        ``row`` and ``reason`` of the rows that could not be used.
    robust : bool
        Whether rows were downweighted (never with fewer than 1.5 values per coefficient) or, if
        few, tested (`few_rows`).
    freedom : ndarray, shape (k,)
        Degrees of freedom of each standard error; infinite if from given sigmas.
    undetermined : tuple of str
        Undetermined coefficients: see `undetermined_terms.Undetermined`.
    raised : list of dict
        Sigmas that were raised, see `rows.Usable`.
    ratios : tuple of float
        See `estimate.Estimate`.
    zeros : PowerOnZero or Zeros
        Zeros subtracted from the encoder's angles. If zeros of the runs were fitted too, these are
        included, with the covariance of their difference from the first run.
    linear : Linearisation or None
        Linearisation of the fit, for refits without some rows.
    """

    model: PointingModel
    names: tuple
    coefficients: np.ndarray
    covariance: np.ndarray
    covariance_from: str
    scatter: tuple
    rank: int
    singular_values: np.ndarray
    dropped: list
    residual_x: np.ndarray
    residual_y: np.ndarray
    weights: np.ndarray
    excluded: list
    robust: bool
    freedom: np.ndarray
    undetermined: tuple = ()
    raised: list = ()
    ratios: tuple = (1.0, 1.0)
    zeros: PowerOnZero | Zeros = NO_ZERO
    linear: Linearisation | None = None

    @property
    def sigma(self):
        """Standard errors of the coefficients, radians, shape (k,); NaN if undetermined."""
        sigma = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        sigma[[self.names.index(name) for name in self.undetermined]] = np.nan
        return sigma

    @property
    def degrees_of_freedom(self):
        """Number of values with weight, less the rank."""
        return 2 * int(np.count_nonzero(self.weights > 0.0)) - self.rank

    @property
    def few(self):
        """Whether there are too few rows for sigmas: two of them cover less than 95 %."""
        return self.degrees_of_freedom < FEW and self.covariance_from != 'given sigmas'

    @property
    def within95(self):
        """Half width of the 95 % confidence interval of each coefficient, radians, shape (k,).

        `sigma` times the quantile of Student's t for its degrees of freedom.
        """
        from scipy.special import stdtrit
        return self.sigma * stdtrit(self.freedom, 0.975)

    def term_rows(self, interval=None):
        """``name``, ``value_arcsec``, ``sigma_arcsec`` of each coefficient; JSON-ready.

        Parameters
        ----------
        interval : bool, optional
            Add ``within95_arcsec`` and ``degrees_of_freedom`` (of its sigma; None: the noise is
            known); by default if the rows are `few`.
        """
        rows = [coefficient_row(name, float(value), float(sigma), name in self.undetermined)
                for name, value, sigma in zip(self.names, self.coefficients, self.sigma)]
        if self.few if interval is None else interval:
            for row, wide, dof in zip(rows, self.within95, self.freedom):
                known = row['sigma_arcsec'] is not None
                row['within95_arcsec'] = float(wide) / ARCSEC if known else None
                row['degrees_of_freedom'] = float(dof) if known and np.isfinite(dof) else None
        return rows

    @property
    def correlations(self):
        """Correlation matrix of the coefficients, shape (k, k); NaN if undetermined."""
        sigma = self.sigma
        sigma = np.where(sigma <= 0.0, 1.0, sigma)
        return self.covariance / np.outer(sigma, sigma)

    @property
    def condition(self):
        """Condition number of the design with columns of unit length."""
        smallest = self.singular_values[-1]
        return float(self.singular_values[0] / smallest) if smallest > 0.0 else np.inf

    @property
    def rejected(self):
        """Indices of the rows rejected by the robust fit (zero weight), without excluded ones."""
        return np.flatnonzero((self.weights == 0.0) & np.isfinite(self.residual_x))

    def findings(self, run):
        """Warnings and notes about the fit.

        Parameters
        ----------
        run : PointingRun
            The fitted run.

        Returns
        -------
        list of Finding
        """
        out = []
        if self.undetermined:
            out.append(undetermined_terms(self.undetermined,
                                          dict(zip(self.names, self.coefficients))))
        word = 'row' if run.meta.get('lines') is None else 'line'
        out += [Finding('raised sigma', evidence={
            **one, 'place': f'{word} {run.lines[one["row"]]}'}) for one in self.raised]
        return [*out, *self.sigma_findings(run.mount.names.axes), *self.freedom_findings]

    def sigma_findings(self, axes):
        """Findings on given sigmas that disagree with the scatter; `axes`: names of the axes."""
        each = {'sigmas multiplied': {axis: one for axis, one in zip(axes, self.ratios)
                                      if one > 1.0},
                'sigmas too large': {axis: one for axis, one in zip(axes, self.ratios)
                                     if one < 1.0}}
        return [Finding(kind, evidence={'ratios': ratios})
                for kind, ratios in each.items() if ratios]

    @property
    def freedom_findings(self):
        """Findings of a fit of few rows; none for other fits."""
        if not self.few:
            return []
        out = [Finding('few degrees of freedom', evidence={'degrees': self.degrees_of_freedom})]
        return out if self.robust else [*out, Finding('rows not judged')]

    def rejected_stars(self, rows):
        """Findings on the stars rejected by the robust fit, largest residual first.

        Parameters
        ----------
        rows : PointingRun
            The fitted rows, with column `star`.
        """
        far = np.hypot(self.residual_x, self.residual_y)
        away = self.rejected[np.argsort(-far[self.rejected], kind='stable')]
        time = rows['time'] if 'time' in rows else np.full(len(rows), np.nan)
        return [Finding('rejected star', float(far[i]) / ARCSEC, evidence={
            'star': int(rows['star'][i]),
            'time': float(time[i]) if np.isfinite(time[i]) else None,
            'x_arcsec': float(self.residual_x[i]) / ARCSEC,
            'y_arcsec': float(self.residual_y[i]) / ARCSEC}) for i in away]

    @property
    def open_directions(self):
        """List of a Finding on each direction that the stars do not determine."""
        return [Finding('open direction', evidence={'direction': one['text']})
                for one in self.dropped]

    def rms_arcsec(self, rejected=True):
        """RMS of the residuals on the fitted rows.

        Parameters
        ----------
        rejected : bool
            Include rows rejected by the robust fit.

        Returns
        -------
        Rms
            arcsec on the sky; `n` is the number of rows.
        """
        keep = slice(None) if rejected else self.weights > 0.0
        return rms_arcsec(self.residual_x[keep], self.residual_y[keep])


def named(rejected, most=5):
    """Findings of `rejected_stars`, those beyond `most` combined into one."""
    more = len(rejected) - most
    return [*rejected[:most], *([Finding('more stars rejected', more, unit='')] * (more > 0))]


def undetermined_terms(names, values):
    """Finding on terms that the stars do not determine.

    Parameters
    ----------
    names : sequence of str
        Names of these terms.
    values : dict of str to float
        Values of all terms; exactly zero for those held.
    """
    held = [name for name in names if values[name] == 0.0]
    return Finding('undetermined terms', evidence={
        'terms': list(names), 'held': held,
        'carrying': [name for name in names if name not in held]})


def _dropped(left_open, names):
    """Directions that the data do not determine, in words."""
    out = []
    for direction, size in zip(left_open.directions, left_open.sizes.tolist()):
        main = [(name, value) for name, value in zip(names, direction.tolist())
                if abs(value) >= 0.1]
        main.sort(key=lambda pair: -abs(pair[1]))
        out.append({'text': ' '.join(f'{value:+.2f} {name}' for name, value in main),
                    'direction': dict(main), 'relative_singular_value': size})
    return out


def make_result(run, names, used, found, model, zeros, notes):
    """`FitResult` of a solution.

    Parameters
    ----------
    run : PointingRun
    names : sequence of str, length k
    used : rows.Usable
    found : estimate.Estimate
    model : PointingModel
        With the coefficients; its provenance is set here.
    zeros : PowerOnZero or Zeros
    notes : dict
        Entries for the provenance.
    """
    sigmas, excluded, scatter = used.sigmas, used.excluded, found.scatter
    n, left_open = len(used.rows), found.undetermined
    residual_x, residual_y, w = (np.full(len(run), v) for v in (np.nan, np.nan, 0.0))
    residual_x[used.rows], residual_y[used.rows] = found.residual.reshape(2, n)
    w[used.rows] = found.weights
    lost = used.rows[~np.isfinite(found.residual[:n])]
    if len(lost):
        excluded = sorted([*excluded, *(
            {'row': int(i), 'reason': BEYOND_COLLIMATION} for i in lost)],
            key=lambda one: one['row'])
    if sigmas is not None:
        scatter = tuple(of * rms(s) for of, s in zip(scatter, sigmas.reshape(2, n)))
    undetermined = tuple(names[i] for i in left_open.terms)
    fitted = rms_arcsec(residual_x, residual_y)
    covariance_from = ('measured scatter' if sigmas is None else
                       'multiplied sigmas' if max(found.ratios) > 1.0 else 'given sigmas')
    facts = {
        'source': run.meta.get('source'),
        'rows': fitted.n,
        'rows_excluded': len(excluded),
        'robust': found.robust,
        'covariance_from': covariance_from,
        'rank': found.rank,
        'fitted_rms_arcsec': {'x': fitted.x, 'y': fitted.y, 'radial': fitted.radial},
        **({} if sigmas is None else {'sigma_ratios': list(found.ratios)}),
        **notes,
    }
    open_directions = left_open.directions
    if not undetermined:
        # a series, of which no coefficient is held: its functions are smooth, so a direction that
        # hardly changes the values at the stars (RMS) changes those between them little, too
        seen = left_open.moves[:, None] / np.sqrt(
            2 * n if sigmas is None else np.sum(np.square(1.0 / sigmas)))
        open_directions = open_directions / np.maximum(1.0, _BEYOND * seen / OPEN)
    directions = [{name: value for name, value in zip(names, one.tolist())
                   if abs(value) > _NOTHING} for one in open_directions]
    model = replace(
        model, provenance=facts, directions=(*model.directions, *filter(None, directions)),
        undetermined=[name for name in model.terms if name in {*model.undetermined, *undetermined}],
        sides=rows_by_side(run.mount, run['el'][w > 0.0]))
    return FitResult(
        model=model, names=tuple(names), coefficients=found.coefficients,
        covariance=found.covariance, covariance_from=covariance_from, scatter=scatter,
        rank=found.rank, singular_values=found.singular_values,
        dropped=_dropped(left_open, names), residual_x=residual_x, residual_y=residual_y,
        weights=w, excluded=excluded, robust=found.robust, freedom=found.freedom,
        undetermined=undetermined, raised=used.raised, ratios=found.ratios, zeros=zeros,
        linear=Linearisation.of(names, found, used.rows, len(run), sigmas))
