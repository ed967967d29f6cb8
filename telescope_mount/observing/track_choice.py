"""Which star a mount that is tracked needs next, and when: from its model alone."""

from copy import copy
from types import SimpleNamespace

import numpy as np

from pointing_model.term_drift import KEY, walks_of
from pointing_model.terms import design

from .next_star import SlewTime, next_star, until

#: no star is waited for longer, s: what jumps is only seen by a star
LONGEST_WAIT = 1800.0
#: the pointing is held within this part of the goal: the star that mends it takes its time too
RESERVE = 0.9


class TrackedModel:
    """What `next_star` asks of a filter, from the model that it publishes.

    Parameters
    ----------
    model : PointingModel
        Of a calibration in mode ``track``.

    Attributes
    ----------
    mount : Mount
    states : tuple of str
        The terms.
    noise : float
        1 sigma of a star along x or y, rad.
    stamp : int
        Of the last star, ns.

    Raises
    ------
    ValueError
        It is of none, or damaged.
    """

    def __init__(self, model):
        walks = walks_of(model)
        if walks is None:
            raise ValueError('no tracked model: the calibration has to be in mode track, with a '
                             'model to begin with (fit, or --reference)')
        try:
            noise = model.provenance[KEY]['evening']['noise']
            self.noise = float(np.sqrt(np.mean(np.square(noise))))
            self.stamp = int(model.provenance['last_stamp_ns'])
        except (KeyError, TypeError, ValueError) as err:
            raise ValueError(f'what the model tells of its tracking is damaged: {err}') from None
        self.mount, self.states = model.mount, tuple(model.terms)
        self._covariance, self._walk = np.asarray(model.covariance), np.square(walks)

    def later(self, seconds):
        """The same so long after, without a star."""
        out = copy(self)
        out._covariance = self.ahead(seconds)
        return out

    def columns(self, az, el):
        """Of the terms at places of the axes, shape (p, 2, k)."""
        return np.stack(design(self.states, az, el, self.mount), axis=1)

    def ahead(self, seconds):
        """Covariance of the terms so long after the last star, shape (k, k)."""
        return self._covariance + np.diag(self._walk * seconds / 3600.0)

    def expected(self, az, el, seconds_ahead=0.0):
        """With an attribute ``radial``: expected error at places, rad, shape (p,)."""
        columns = self.columns(np.atleast_1d(az), np.atleast_1d(el))
        return SimpleNamespace(radial=np.sqrt(np.einsum(
            'pij,jk,pik->p', columns, self.ahead(seconds_ahead), columns)))


def next_time(model, goal, az, el):
    """How long after the last star the next one is due, s.

    Parameters
    ----------
    model : TrackedModel
    goal : float
        Radial RMS over the places, rad.
    az, el : ndarray, shape (p,)
        That matter, by the axes, rad.
    """
    return until(model, (az, el), RESERVE * goal, LONGEST_WAIT)


def choose_next(model, az, el, here, exposure, waited, rate):
    """The star that helps the pointing over all candidates most for its time.

    Parameters
    ----------
    model : TrackedModel
    az, el : ndarray, shape (n,)
        Candidates by the axes, rad; they stand for the sky too.
    here : (float, float)
        Where the axes are, rad.
    exposure : float
        With readout and centring, s.
    waited : float
        Since the last star, s.
    rate : float
        Of either axis in a slew, rad/s.

    Returns
    -------
    next_star.Choice
    """
    return next_star(model.later(waited), az, el, here, (az, el), sigma=model.noise,
                     exposure_s=exposure, slew=SlewTime((rate, rate)))
