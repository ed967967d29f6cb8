"""What no mount has: the sizes beyond which a model or a zero is taken from nobody.

They are no expectation of a good mount. A zero of an incremental encoder may be any angle of a
turn, and so may the index terms, which are the same thing.
"""

import numpy as np

from msg_tools.units import ARCSEC, DEG

#: index terms of the axes: zeros by another name
_INDEX = ('IA', 'IE', 'IH', 'ID')
#: a turn; a right angle, beyond which an axis, a tube or a camera stands for another; rad
_TURN, _RIGHT = 360.0 * DEG, 90.0 * DEG
#: by how much rounding may make a covariance larger than its variances allow, of them
_ROUNDING = 1e-3


def check_model(model):
    """Refuse a model of no mount.

    Parameters
    ----------
    model : PointingModel

    Raises
    ------
    ValueError
        A term beyond a right angle (an index term, a coefficient of the harmonics or of an
        effect: beyond a turn), or a covariance that is none or gives a sigma beyond a turn. One
        line that names it.
    """
    for name, value in model.terms.items():
        most = _TURN if name in _INDEX else _RIGHT
        if not abs(value) <= most:
            raise ValueError(f'a model with {name} = {value / ARCSEC:.4g} arcsec, which no mount '
                             f'has (at most {most / DEG:.0f} deg)')
    _check_covariance('a model', model.covariance, list(model.terms))
    series = model.harmonics
    if series is not None:
        _check_largest('harmonics', np.concatenate([np.ravel(series.coef_x),
                                                    np.ravel(series.coef_y)]))
        if not np.isfinite(series.covariance).all():
            raise ValueError('a model with harmonics whose covariance is not finite')
    for fitted in model.effects:
        _check_largest(fitted.effect.name, np.ravel(fitted.coefficients))


def check_zero(zero):
    """Refuse a zero of no encoder.

    Parameters
    ----------
    zero : RunZero

    Raises
    ------
    ValueError
        An angle or a sigma is beyond a turn, or is no number. One line that says which.
    """
    for axis, value in zip(('first', 'second'), zero.angles):
        if not abs(value) <= _TURN:
            raise ValueError(f'a zero of {value:.4g} rad on the {axis} axis: no angle of an axis '
                             '(at most one turn)')
    if zero.covariance is not None:
        _check_covariance('a zero', np.asarray(zero.covariance), ['the first axis',
                                                                  'the second axis'])


def _check_largest(what, values):
    if not (np.abs(values) <= _TURN).all():
        raise ValueError(f'a model with {what} of up to {np.abs(values).max() / ARCSEC:.4g} '
                         'arcsec, which no mount has')


def _check_covariance(what, covariance, names):
    if len(covariance) == 0:
        return
    variance = np.diag(covariance)
    bad = np.flatnonzero(~(np.abs(variance) <= _TURN**2))
    if len(bad):
        sigma = np.sqrt(np.abs(variance[bad[0]])) / ARCSEC
        raise ValueError(f'{what} with a sigma of {sigma:.4g} arcsec of {names[bad[0]]}: more '
                         'than a turn')
    room = _ROUNDING * variance.max()
    most = np.sqrt(np.outer(np.maximum(variance, 0.0), np.maximum(variance, 0.0)))
    if variance.min() < -room or not (np.abs(covariance) <= most + room).all():
        raise ValueError(f'{what} with a covariance that is none: it is larger than its own '
                         'variances allow')
