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

"""What a graduated disc shows to its reading heads: eccentric, tilted, by sine and cosine."""

import numpy as np

from msg_tools.units import wrap


def disc_angle(angle, eccentricity, phase, radius, heads=1):
    """Angle that a graduated disc shows to its reading head.

    The disc's centre moves around the axis; the head reads the point of the disc on the line from
    the disc's centre to the head.

    Parameters
    ----------
    angle : ndarray
        Axis angle, rad; turns are kept.
    eccentricity, radius : float
        Distance of the centres and radius of the graduation, in the same unit.
    phase : float
        Axis angle at which the disc's centre lies farthest from the (first) head, rad.
    heads : {1, 2}
        One head, or the mean of two opposite ones.

    Returns
    -------
    ndarray
        rad. With one head about angle - (eccentricity / radius) sin(angle - phase): 5.2" per
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
    """Angle shown by a disc that is not perpendicular to its axis.

    Parameters
    ----------
    angle : ndarray
        Axis angle, rad; turns are kept.
    tilt : float
        Angle between the disc and the plane normal to the axis, rad.
    phase : float
        Axis angle at which the line of intersection of both planes is at the head, rad.

    Returns
    -------
    ndarray
        rad: the graduation projected on the plane of the head, tan(shown) = tan(angle) / cos tilt
        from that line on; about angle + (tilt^2 / 4) sin 2(angle - phase).
    """
    if tilt == 0.0:
        return np.array(angle, dtype=float)
    s, c = np.sin(angle - phase), np.cos(angle - phase)
    # add only the difference, so that turns are kept
    return angle + np.arctan2((1.0 - np.cos(tilt)) * s * c, np.cos(tilt) * c * c + s * s)


class SineSignals:
    """The pair of signals (sine and cosine) of one reading head.

    Parameters
    ----------
    params : incremental.Incremental
        Uses `offset_cos`, `offset_sin`, `amplitude_mismatch`, `quadrature_error` and `bandwidth`.

    Attributes
    ----------
    ideal : bool
        Whether the arctangent is the phase of the grating at any rate.

    Notes
    -----
    With gain g and phase d of the low-pass at the rate, A = g (1 + m / 2) cos(p - d) + a and
    B = g (1 - m / 2) sin(p - d + q) + b. To first order the error of atan2(B, A) is
    (b cos p - a sin p) / g - d once a line and -(m / 2) sin 2p + (q / 2) (1 + cos 2p) twice
    (Heydemann 1981, Appl. Opt. 20, 3382; for tape encoders of a telescope Warner, Krabbendam &
    Schumacher 2008, Proc. SPIE 7012, 70123N: first and second harmonic dominate).
    """

    def __init__(self, params):
        p = self._params = params
        self._amplitudes = 1.0 + 0.5 * p.amplitude_mismatch, 1.0 - 0.5 * p.amplitude_mismatch
        self._round = p.offset_cos == p.offset_sin == 0.0
        self.ideal = self._round and p.amplitude_mismatch == p.quadrature_error == p.bandwidth == 0

    def _filtered(self, rate):
        """Gain and phase lag (rad) of a first-order low-pass."""
        p = self._params
        if p.bandwidth == 0.0:
            return np.float64(1.0), np.float64(0.0)
        tangent = p.lines * np.asarray(rate) / (2.0 * np.pi * p.bandwidth)
        return 1.0 / np.hypot(1.0, tangent), np.arctan(tangent)

    def shown(self, angle, rate=0.0):
        """Angle given by the arctangent.

        Parameters
        ----------
        angle : float or ndarray
            Angle of the grating, rad; turns are kept.
        rate : float or ndarray
            rad/s.

        Returns
        -------
        ndarray
            rad.
        """
        p = self._params
        gain, late = self._filtered(rate)
        phase = p.lines * np.asarray(angle) - late
        wide, high = self._amplitudes
        shown = np.arctan2(gain * high * np.sin(phase + p.quadrature_error) + p.offset_sin,
                          gain * wide * np.cos(phase) + p.offset_cos)
        return angle + (wrap(shown - phase) - late) / p.lines

    def counting(self, rate):
        """Whether lines are counted, which needs an ellipse around the origin.

        Parameters
        ----------
        rate : float or ndarray
            rad/s.

        Returns
        -------
        ndarray of bool
        """
        p = self._params
        if self._round:
            return np.ones(np.shape(rate), dtype=bool)
        gain, _ = self._filtered(rate)
        wide, high = self._amplitudes
        # the origin in coordinates in which the ellipse is the unit circle
        x, y = -p.offset_cos / (gain * wide), -p.offset_sin / (gain * high)
        askew = p.quadrature_error
        return np.hypot(x, (y - x * np.sin(askew)) / np.cos(askew)) < 1.0
