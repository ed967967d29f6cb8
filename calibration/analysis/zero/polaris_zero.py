"""The encoders' zero from Polaris: its change since a reference. Of other stars see `stars_zero`.

Polaris alone measures IA + CA / cos E + (NPAE + AW cos A) tan E + ... in azimuth and
IE + AN cos A + TF cos E + ... in elevation, so it cannot give IA and IE themselves. It gives
how much the zero moved since a time when those other terms were the same, and `contamination`
says by how much a change of each of them would falsify that.
"""

from dataclasses import dataclass

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.held_terms import is_a_model
from pointing_model.model import PointingModel
from pointing_model.mounts import ALTAZ, Mount
from pointing_model.terms import mean_columns
from pointing_model.zero import BY_POLARIS, RunZero

from ...rows import usable
from ..fit import fit_terms

#: reference of a zero that is the whole offset at Polaris
NO_MODEL = 'no model'
#: below, weights do not help: one exposure 20" off leaves 6.5" of error among 3 and 4.2" among 4
#: with them, 6.7" and 5.0" without; among 5 it is 1.6" and 4.0", among 8 0.4" and 2.6"
FEWEST_FOR_ROBUST = 5


@dataclass(frozen=True, kw_only=True)
class MeasuredZero(RunZero):
    """Change of the zero of both axes, with all that it rests on.

    Attributes
    ----------
    az, el, covariance, run
        See `RunZero`; the covariance is of these exposures and of the reference.
    n : int
        Exposures used.
    reference : str
        What the change is relative to.
    sigma_from : {'given sigmas', 'measured scatter'}
        The latter is widened (Student) so that one sigma holds 68 % of the cases.
    contamination : dict of str to dict of str to float
        ``contamination['az']['CA']``: by how many seconds of arc the zero is false if that term
        has changed by one since the reference; ``['el']`` likewise.
    rejected : int
        Exposures without weight in the robust mean.
    by : str
        The way, see `pointing_model.zero.way_of`.
    mount : Mount
        Whose axes.
    noise : ndarray, shape (2, 2), optional
        Covariance by the noise of the exposures alone, radians^2; None: `covariance` is that.
    misfit : float
        By how much the covariance was widened (as a sigma) since the stars disagree by more than
        their noise and what is held allow; 1: they do not.
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
        """Its covariance where a model goes with it that was fitted to these exposures too."""
        if self.noise is not None and self.reference == NO_MODEL:
            return self.noise
        return self.covariance

    def contained(self, names):
        """How much of each term the zero has in it, shape (2, k); of itself all."""
        own = self.mount.names.index
        return np.array([[float(i == own.index(name)) if name in own else
                          self.contamination[axis].get(name, 0.0) for name in names]
                         for i, axis in enumerate(('az', 'el'))])

    def statement(self):
        """What the zero rests on, in words: terms that its exposures cannot tell from it."""
        def list_of(axis):
            parts = sorted(self.contamination[axis].items(), key=lambda item: -abs(item[1]))
            return ', '.join(f'{name} {v:+.2f}\u2033' for name, v in parts if abs(v) >= 0.005)
        first, second = self.mount.names.axes
        by = '' if self.by == BY_POLARIS else f'by {self.by}: '
        wide = '' if self.misfit == 1.0 else (
            f'; the stars disagree by {self.misfit:.1f} times what their noise and the held terms '
            'allow (a term has changed): sigma is widened by that')
        if self.reference == NO_MODEL and not (list_of('az') or list_of('el')):
            return (f'{by}no earlier model is its reference: the stars themselves tell the zero '
                    f'from the other terms, as well as its sigma says{wide}')
        if self.reference == NO_MODEL:
            return (f'{by}no earlier model is its reference, so the other terms are in the zero. '
                    f'1\u2033 of a term shifts it: {first} by {list_of("az")}; {second} by '
                    f'{list_of("el")}{wide}')
        return (f'{by}the zero is right as long as the other terms are as they were at its '
                f'reference ({self.reference}). 1\u2033 of change in one of them makes it wrong: '
                f'{first} by {list_of("az")}; {second} by {list_of("el")}{wide}')

    def to_dict(self):
        """Numbers for a log or a provenance, in arcsec; ``by`` where it is not Polaris."""
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
            'statement': self.statement(),
            **other,
        }


def student_factor(dof):
    """The 84.13 % point of Student's t: what widens one sigma when it is itself estimated.

    Parameters
    ----------
    dof : float
        Degrees of freedom, at least 1.

    Returns
    -------
    float
        Cornish-Fisher series at one normal sigma, 1.3 % low for one degree of freedom and
        better than 0.1 % from two.
    """
    return 1.0 + 1.0 / (2.0 * dof) + 1.0 / (4.0 * dof**2) + 1.0 / (16.0 * dof**3)


def _mean(exposures, encoder, model, name):
    """Robust mean of (encoder - model) as coordinate angles, with its covariance."""
    rows = usable(exposures, encoder)
    finite = len(rows.rows)
    if finite == 0:
        raise ValueError(f'no usable exposure of Polaris ({name}); observe it first')
    if finite == 1 and rows.sigmas is None:
        raise ValueError(
            f'one exposure of Polaris ({name}) has no scatter; give sigma_x and '
            'sigma_y or expose again')
    # an empty model is held where there is none: the same arithmetic, to the bit
    mount = exposures.mount
    fit = fit_terms(exposures, mount.names.index, held=model or PointingModel({}, mount=mount),
                    encoder=encoder, robust=finite >= FEWEST_FOR_ROBUST)
    covariance = fit.covariance
    weight = float(fit.weights.sum())
    if fit.covariance_from == 'measured scatter':
        covariance = covariance * student_factor(max(weight - 1.0, 1.0)) ** 2
    used = fit.weights > 0.0
    return fit, covariance, exposures['az'][used], exposures['el'][used]


def zero_from_polaris(exposures, reference, *, encoder='enc', model=None, run=None,
                      reference_name='an earlier power-on', means=None):
    """Change of the encoders' zero since a reference, from exposures of Polaris.

    Parameters
    ----------
    exposures : PointingRun
        Its rows are Polaris, all of them. Without ``sigma_x`` and ``sigma_y`` the scatter of the
        exposures gives their noise.
    reference : PointingRun or PointingModel
        Exposures of an earlier power-on, or a model whose prediction at Polaris is the zero
        that its IA and IE stand for; the model's covariance enters the result's.
    encoder : {'enc', 'abs'}
        The pair of encoder columns.
    model : PointingModel, optional
        With reference exposures: takes out how the offset changes between the two places of
        Polaris on its circle (0.6" per minute of arc of collimation). Its covariance enters.
    run : int, optional
        Number of the power-on of the exposures.
    reference_name : str
        What the report calls the reference exposures.
    means : dict, optional
        Of many changes by one model and encoder: keeps the means of exposures, by `id`, that are
        now in this change and then in the next.

    Returns
    -------
    MeasuredZero

    Raises
    ------
    ValueError
        No usable exposure, or only one and no sigma, here or in the reference; or `model`
        beside a reference that is a model.
    """
    if isinstance(reference, PointingModel):
        if model is not None:
            raise ValueError('the reference is a model already; leave out the second one')
        model = reference
    means = {} if means is None else means

    def mean(part, name):
        if id(part) not in means:
            means[id(part)] = _mean(part, encoder, model, name)
        return means[id(part)]

    fit, covariance, now_az, now_el = mean(exposures, 'tonight')
    value, mount = fit.coefficients, exposures.mount
    if isinstance(reference, PointingModel):
        columns = mean_columns(tuple(model.terms), now_az, now_el, mount)
        covariance = covariance + columns @ model.covariance @ columns.T
        if model.harmonics is not None:
            vx, vy = model.harmonics.variance(now_az, now_el)
            covariance = covariance + np.diag(
                [np.mean(vx / np.cos(now_el) ** 2), np.mean(vy)])
        description = told_model(model)
    else:
        then, then_covariance, then_az, then_el = mean(reference, reference_name)
        value = value - then.coefficients
        covariance = covariance + then_covariance
        if model is not None:
            names = tuple(model.terms)
            moved = (mean_columns(names, now_az, now_el, mount)
                     - mean_columns(names, then_az, then_el, mount))
            covariance = covariance + moved @ model.covariance @ moved.T
        description = f'{np.count_nonzero(then.weights)} exposures of Polaris, {reference_name}'
    others = other_terms(mount)
    return MeasuredZero(
        run=run, az=float(value[0]), el=float(value[1]), covariance=covariance, n=len(now_az),
        reference=description, sigma_from=fit.covariance_from,
        contamination=contamination(others, mean_columns(others, now_az, now_el, mount)),
        rejected=len(fit.rejected), mount=mount)


def other_terms(mount):
    """The physical terms of a mount but its zeros."""
    return tuple(name for name in mount.names.physical if name not in mount.names.index)


def contamination(names, false):
    """`MeasuredZero.contamination` from what each term falsifies, shape (2, k)."""
    return {axis: {name: float(v) for name, v in zip(names, row) if v != 0.0}
            for axis, row in zip(('az', 'el'), false)}


def told_model(model):
    """A PointingModel as the reference of a zero, in words."""
    if not is_a_model(model):
        return NO_MODEL
    source = model.provenance.get('source')
    return 'prediction of the pointing model' + (f' from {source}' if source else '')
