"""Sine and cosine of a grating, as the electronics get them, and what the arctangent makes of them.

On an oscilloscope both signals draw a circle about the origin, a line of the grating a turn. Here
the circle is off the origin, an ellipse and askew, and smaller and late at speed.
"""

import numpy as np

from msg_tools.units import wrap


class SineSignals:
    """The pair of signals of one reading head.

    Parameters
    ----------
    params : scenario_encoders.Incremental
        Its `offset_cos`, `offset_sin`, `amplitude_mismatch`, `quadrature_error` and `bandwidth`.

    Attributes
    ----------
    ideal : bool
        Whether the arctangent gives the phase of the grating at any rate.

    Notes
    -----
    With g and d of the bandwidth at the rate, A = g (1 + m / 2) cos(p - d) + a and
    B = g (1 - m / 2) sin(p - d + q) + b. To first order the error of atan2(B, A) is
    (b cos p - a sin p) / g - d once a line and -(m / 2) sin 2p + (q / 2) (1 + cos 2p) twice
    (Heydemann 1981, Appl. Opt. 20, 3382; on the tape encoders of a telescope Warner, Krabbendam &
    Schumacher 2008, Proc. SPIE 7012, 70123N: first and second harmonic dominate).
    """

    def __init__(self, params):
        p = self._params = params
        self._amplitudes = 1.0 + 0.5 * p.amplitude_mismatch, 1.0 - 0.5 * p.amplitude_mismatch
        self._round = p.offset_cos == p.offset_sin == 0.0
        self.ideal = self._round and p.amplitude_mismatch == p.quadrature_error == p.bandwidth == 0

    def _filtered(self, rate):
        """Amplitude left and phase behind (rad), of a low-pass of first order."""
        p = self._params
        if p.bandwidth == 0.0:
            return np.float64(1.0), np.float64(0.0)
        tangent = p.lines * np.asarray(rate) / (2.0 * np.pi * p.bandwidth)
        return 1.0 / np.hypot(1.0, tangent), np.arctan(tangent)

    def shown(self, angle, rate=0.0):
        """Angle that the arctangent gives.

        Parameters
        ----------
        angle : float or ndarray
            Of the grating, rad; turns are kept.
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
        seen = np.arctan2(gain * high * np.sin(phase + p.quadrature_error) + p.offset_sin,
                          gain * wide * np.cos(phase) + p.offset_cos)
        return angle + (wrap(seen - phase) - late) / p.lines

    def counting(self, rate):
        """Whether lines are counted: no more where the ellipse does not go round the origin.

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
        # the origin, where the ellipse is the unit circle
        x, y = -p.offset_cos / (gain * wide), -p.offset_sin / (gain * high)
        askew = p.quadrature_error
        return np.hypot(x, (y - x * np.sin(askew)) / np.cos(askew)) < 1.0
