"""What every encoder has in common: a disc off its centre, and a zero that moves."""

import numpy as np

from . import keyed_noise


def disc_angle(angle, eccentricity, phase, radius, heads=1):
    """Angle that a graduated disc shows to its reading head.

    The disc's centre goes round the axis; the head looks at the place of the disc that lies on
    the line from the disc's centre to the head.

    Parameters
    ----------
    angle : ndarray
        Of the axis, rad; turns are kept.
    eccentricity, radius : float
        Distance of the centres, radius of the graduation, in one unit.
    phase : float
        Axis angle at which the disc's centre lies farthest from the (first) head, rad.
    heads : {1, 2}
        One head, or the mean of two opposite ones.

    Returns
    -------
    ndarray
        rad. With one head about angle - (eccentricity / radius) sin(angle - phase): 5.2" a
        micrometre on a circle of 79 mm (paper 001).
    """
    if eccentricity == 0.0:
        return np.array(angle, dtype=float)
    # the centre lies at -(along, across), the heads at (+-radius, 0)
    along, across = eccentricity * np.cos(angle - phase), eccentricity * np.sin(angle - phase)
    lead = np.arctan2(across, radius + along)
    if heads == 2:
        lead = 0.5 * (lead + np.arctan2(-across, radius - along))
    return angle - lead


def tilted_angle(angle, tilt, phase):
    """Angle that a disc shows whose plane is not across its axis.

    Parameters
    ----------
    angle : ndarray
        Of the axis, rad; turns are kept.
    tilt : float
        Between the disc's plane and that across the axis, rad.
    phase : float
        Axis angle at which the line of both planes lies at the head, rad.

    Returns
    -------
    ndarray
        rad: the graduation projected on the plane of the head, tan(shown) = tan(angle) / cos tilt
        from that line on; about angle + (tilt^2 / 4) sin 2(angle - phase).
    """
    if tilt == 0.0:
        return np.array(angle, dtype=float)
    s, c = np.sin(angle - phase), np.cos(angle - phase)
    # the difference alone, so that turns are kept
    return angle + np.arctan2((1.0 - np.cos(tilt)) * s * c, np.cos(tilt) * c * c + s * s)


class ZeroDrift:
    """The zero of an encoder: mounting, power-on, time, temperature.

    Parameters
    ----------
    params : scenario_encoders.EncoderScale
        Of the encoder.
    seed : int
    device : str
        Name of the encoder and axis, for the random numbers.
    """

    def __init__(self, params, seed, device):
        self._params, self._seed, self._device = params, seed, device
        self._drawn = {}

    def at_power_on(self, power_on):
        """Shift of the reading since this power-on (1, 2, ...), rad."""
        if power_on not in self._drawn:  # each sample asks for it
            self._drawn[power_on] = self._at_power_on(power_on)
        return self._drawn[power_on]

    def _at_power_on(self, power_on):
        p = self._params
        if p.zero_drifts:
            return p.zero_drifts[min(power_on, len(p.zero_drifts)) - 1]
        if p.zero_drift == 0.0:
            return 0.0
        return p.zero_drift * float(
            keyed_noise.normal(self._seed, self._device, 'zero drift', power_on)
        )

    def later(self, seconds, temperature):
        """Shift of the reading with time and temperature, rad.

        Parameters
        ----------
        seconds : ndarray
            Since the start of the night.
        temperature : float or ndarray
            degC.
        """
        p = self._params
        return (
            p.zero_rate * np.asarray(seconds)
            + p.zero_slope * (np.asarray(temperature) - p.reference_temperature)
        )
