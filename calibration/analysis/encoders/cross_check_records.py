"""What the witnesses of an axis said, and what it is taken for: see `cross_check`."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.zero import BY_POLARIS


@dataclass(frozen=True)
class Witness:
    """What encoders and Polaris said in one power-on.

    Attributes
    ----------
    run : float
        Number of the power-on; with a hundredth more for each that the absolute encoder had in it.
    az, el : float
        Mean place of Polaris, rad.
    enc, abs : ndarray, shape (2,)
        Encoder - sky at Polaris, azimuth and elevation, coordinate angles, rad.
    covariance : ndarray, shape (2, 2, 2)
        Of (enc, abs) of each axis, rad^2: they share the star's noise.
    apart, apart_sigma : ndarray, shape (2,)
        Incremental - absolute at that place, by all rows of the power-on, and 1 sigma, rad.
    exposures : int
        Of Polaris; where they resemble the one before, as many as independent ones would do.
    stars : tuple of ndarray, optional
        Where stars were exposed in place of Polaris: azimuth and elevation of each (s,), rad, and
        with which weights (2, s) their offsets on the sky make `enc` and `abs`.
    """

    run: float
    az: float
    el: float
    enc: np.ndarray
    abs: np.ndarray
    covariance: np.ndarray
    apart: np.ndarray
    apart_sigma: np.ndarray
    exposures: int
    stars: tuple | None = None


@dataclass(frozen=True)
class Change:
    """What moved on an axis from one power-on (or night) to the next, rad.

    `incremental` and `absolute` are against the sky at Polaris, `apart` is incremental - absolute.
    `pull` is the absolute encoder's change over its expected sigma, which holds the noise and
    what is usual for the encoder: how far the zeros by Polaris and by the absolute encoder
    disagree. `moved` are posterior probabilities, where something other than the incremental
    encoder moved; `tilt`, that the mount leans, as all of its stars show. `cause` is the likeliest
    of `witness_causes`, with `causes` before it is asked whether there was an alarm. `by`: the sky
    is Polaris, or stars.
    """

    axis: str
    since: float
    run: float
    incremental: float
    incremental_sigma: float
    absolute: float
    absolute_sigma: float
    apart: float
    apart_sigma: float
    pull: float
    probability: float
    alarm: bool
    moved: dict
    tilt: float
    cause: str
    causes: dict
    by: str = BY_POLARIS


@dataclass(frozen=True)
class EncoderEvent:
    """Something that moved inside a power-on.

    `kind` is ``step`` (amount in rad, at `time`), ``drift`` (amount in rad/s) or ``wander`` (a
    random walk, amount in rad from its lowest to its highest). The amount is
    what the witness `moved` names read too much, with that `confidence` (posterior).
    `probability` is the chance of such a step anywhere in the night without one. Where `moved` is
    `BOTH`, the amount is that of the incremental encoder, and `second` that of the absolute one.
    """

    axis: str
    run: float
    kind: str
    time: float
    amount: float
    sigma: float
    moved: str
    confidence: float
    probability: float
    second: float = np.nan
    second_sigma: float = np.nan


class Budget(NamedTuple):
    """What is usual, 1 sigma in rad, and the chance of a false alarm."""

    #: change of the absolute encoder's zero
    absolute: float = 0.5 * ARCSEC
    #: change of the incremental encoder's zero at a power-on
    power_on: float = 20.0 * ARCSEC
    #: of the mount's terms, where no model is given
    term: float = 60.0 * ARCSEC
    #: size of what is not usual; only the posterior probabilities depend on it
    anomaly: float = 20.0 * ARCSEC
    #: nights with an alarm by chance, by all tests of one of three kinds together: inside a
    #: power-on, against the sky, from power-on to power-on
    false_alarm: float = 0.005 / 3
    #: chance that a jump inside a power-on of one is called one of both
    second: float = 0.01


USUAL = Budget()
