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

"""Zeros of the encoders in each power-on, relative to a model or an earlier power-on.

Polaris alone measures IA + CA / cos E + (NPAE + AW cos A) tan E + ... in azimuth and
IE + AN cos A + TF cos E + ... in elevation, so it cannot give IA and IE themselves. It gives
the change of the zero since a time when those other terms were the same. `contamination` is the
error of that change per unit change of each other term. Stars elsewhere separate some of the terms
(`zero_estimate`).
"""

from contextlib import nullcontext, suppress
from dataclasses import dataclass

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.model import PointingModel
from pointing_model.mounts import ALTAZ, Mount
from pointing_model.zero import BY_POLARIS, PowerOnZero, is_for_zero, is_marked
from pointing_model.zero_held_terms import is_a_model

from ...rows import by_power_on, zero_exposures_by_power_on
from ..term_fit import fit_terms
from .zero_estimate import estimate_zeros

#: reference of a zero that is the whole offset at Polaris
NO_MODEL = 'no model'
#: smallest contamination, per arcsec: less is rounding error
_ROUNDING = 1e-9


@dataclass(frozen=True, kw_only=True)
class MeasuredZero(PowerOnZero):
    """Change of the zero of both axes, with its reference and uncertainties.

    Attributes
    ----------
    az, el, covariance, run
        See `PowerOnZero`; the covariance includes these exposures and the reference.
    n : int
        Number of exposures used.
    reference : str
        Reference of the change.
    sigma_from : {'given sigmas', 'measured scatter'}
        The latter is widened (Student) so that one sigma contains 68 % of the cases.
    contamination : dict of str to dict of str to float
        ``contamination['az']['CA']``: error of the zero, arcsec, per arcsec by which that term has
        changed since the reference; ``['el']`` likewise.
    rejected : int
        Exposures without weight.
    by : str
        Method, see `pointing_model.zero.way_of`.
    mount : Mount
        Mount of the axes.
    noise : ndarray, shape (2, 2), optional
        Covariance from the noise of the exposures alone, radians^2; None: `covariance` is that.
    misfit : float
        Factor by which sigma was widened because the stars disagree by more than their noise and
        the held terms allow; 1: they agree.
    """

    n: int
    reference: str
    sigma_from: str
    contamination: dict
    rejected: int
    by: str = BY_POLARIS
    mount: Mount = ALTAZ
    noise: np.ndarray | None = None
    misfit: float = 1.0

    @property
    def with_fitted_terms(self):
        """Its covariance when used with a model that was also fitted to these exposures."""
        if self.noise is not None and self.reference == NO_MODEL:
            return self.noise
        return self.covariance

    def contained(self, names):
        """Contamination of the zero by each term, shape (2, k); 1 for the index term itself."""
        own = self.mount.names.index
        return np.array([[float(i == own.index(name)) if name in own else
                          self.contamination[axis].get(name, 0.0) for name in names]
                         for i, axis in enumerate(('az', 'el'))])

    def to_dict(self):
        """Numbers for a log or a provenance, in arcsec; ``by`` if it is not Polaris."""
        other = {} if self.by == BY_POLARIS else {'by': self.by, 'misfit': self.misfit}
        return {
            **super().to_dict(),
            'sigma_az_arcsec': self.sigma_az / ARCSEC,
            'sigma_el_arcsec': self.sigma_el / ARCSEC,
            'exposures': self.n,
            'rejected': self.rejected,
            'reference': self.reference,
            'sigma_from': self.sigma_from,
            'contamination': self.contamination,
            **other,
        }


def _measured(found, pick, place, run, reference, seen_by=None):
    """`MeasuredZero` from the linear combination `pick` (2, 2g) of zeros of a ZeroEstimate."""
    names, false = found.contamination(pick, seen_by)
    az, el = pick @ found.value * ARCSEC
    return MeasuredZero(
        run=run, az=float(az), el=float(el),
        covariance=pick @ found.covariance @ pick.T * ARCSEC**2,
        noise=pick @ found.noise @ pick.T * ARCSEC**2, n=found.used[place], reference=reference,
        sigma_from='measured scatter' if found.rows.sigmas is None else 'given sigmas',
        contamination={axis: {name: float(v) for name, v in zip(names, row) if abs(v) > _ROUNDING}
                       for axis, row in zip(('az', 'el'), false)},
        rejected=found.rejected[place], by=found.ways[place], mount=found.rows.mount,
        misfit=found.misfit)


def zero_from_exposures(exposures, reference, *, encoder='enc', model=None, run=None,
                        reference_name='an earlier power-on'):
    """Change of the encoders' zero since a reference, from exposures of Polaris or of stars.

    Parameters
    ----------
    exposures : PointingRun
        All of its rows are for the zero, see `pointing_model.zero.is_for_zero`. Without
        ``sigma_x`` and ``sigma_y`` the noise is taken from their scatter.
    reference : PointingRun or PointingModel
        Exposures of an earlier power-on, or a model; the change is then relative to the zero of its
        IA and IE. The model's covariance is included in the result.
    encoder : {'enc', 'abs'}
        The pair of encoder columns.
    model : PointingModel, optional
        With reference exposures: corrects for the different positions, as of Polaris on its circle
        (0.6" per arcminute of collimation). Its covariance is included. It must not be fitted to
        these exposures: their noise would be treated as independent.
    run : int, optional
        Number of the power-on of the exposures.
    reference_name : str
        Name of the reference exposures in the report.

    Returns
    -------
    MeasuredZero

    Raises
    ------
    ValueError
        No usable exposure, or only one and no sigma, here or in the reference; or `model` is given
        although the reference is a model.
    """
    if isinstance(reference, PointingModel):
        if model is not None:
            raise ValueError('the reference is a model already; leave out the second one')
        found = estimate_zeros([exposures], ['tonight'], reference, encoder)
        return _measured(found, np.eye(2), 0, run, _model_name(reference))
    found = estimate_zeros([exposures, reference], ['tonight', reference_name], model, encoder)
    # a change of a term affects the new exposures only
    return _measured(found, np.hstack((np.eye(2), -np.eye(2))), 0, run,
                     f'{found.used[1]} exposures of {found.ways[1]}, {reference_name}', seen_by=0)


def _model_name(model):
    """A PointingModel as the reference of a zero."""
    if not is_a_model(model):
        return NO_MODEL
    source = model.provenance.get('source')
    return f'the model of {source}' if source else 'a model'


def night_zeros(rows, reference, needed=None):
    """The zero of each power-on with enough exposures.

    Parameters
    ----------
    rows : PointingRun
        All rows of the night.
    reference : PointingModel or None
        Model of an earlier night.
    needed : int, optional
        A power-on that must have enough, if it has any.

    Returns
    -------
    zeros : dict of int to MeasuredZero
        Estimated jointly for all power-ons if stars were exposed and there is no reference.
    parts : dict of int to PointingRun
        The exposures.

    Raises
    ------
    ValueError
        `needed` has too few.
    """
    reference = reference or PointingModel({}, mount=rows.mount)
    zeros, parts = {}, {}
    for number, part in zero_exposures_by_power_on(rows):
        with nullcontext() if number == needed else suppress(ValueError):
            zeros[number] = zero_from_exposures(part, reference, run=number)
            parts[number] = part
    if is_a_model(reference) or not any(is_marked(part).any() for part in parts.values()):
        return zeros, parts
    found = estimate_zeros(list(parts.values()), [f'power-on {number}' for number in parts], None,
                           'enc')
    each = np.eye(2 * len(parts)).reshape(len(parts), 2, -1)
    return {number: _measured(found, each[place], place, number, NO_MODEL)
            for place, number in enumerate(parts)}, parts


def zero_changes(rows, numbers, model):
    """Change of the zero from each power-on to the next.

    Parameters
    ----------
    rows : PointingRun
        Fitted rows, including exposures for zeros.
    numbers : sequence of int
        Power-ons with such exposures.
    model : PointingModel
        Model of the fit.

    Returns
    -------
    list of (int, int, MeasuredZero)
        Power-ons before and after, and the change.
    """
    if is_marked(rows).any():
        model = _terms_of_stars(rows)
    return [(before, after, zero_change(rows, before, after, model))
            for before, after in zip(numbers, numbers[1:])]


def zero_change(rows, before, after, model):
    """Change of the zero between two power-ons, a MeasuredZero.

    `model` corrects for the different positions of the exposures.
    """
    parts = by_power_on(rows.select(is_for_zero(rows)))
    return zero_from_exposures(parts[after], parts[before], model=model,
                               reference_name=f'power-on {before:.0f}')


def _terms_of_stars(rows):
    """Model fitted without the exposures: held terms must be independent of these.

    None if there are too few stars.
    """
    with suppress(ValueError, np.linalg.LinAlgError):
        return fit_terms(rows.select(~is_for_zero(rows)), run_zeros=True).model
    return None
