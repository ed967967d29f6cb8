"""Processes in time that depend on seed and time alone: sums of sines with keyed phases.

An AR process would have to be stepped from the start of the night. A sum of many sines with the
same spectrum (M. Shinozuka & C.-M. Jan 1972, J. Sound Vib. 25, 111) can be asked for any time, in
any order, and its mean over an exposure is exact.
"""

import numpy as np

from . import keyed_noise

#: sines in a decade of frequency, each somewhere in its own part of it
_A_DECADE = 40
_CHUNK = 4096


class SlowNoise:
    """A process of mean 0, by default of standard deviation 1.

    Parameters
    ----------
    spectrum : callable
        One-sided power spectrum at frequencies (n,), Hz; its size does not matter.
    slowest, fastest : float
        Between them it is taken, Hz.
    seed : int
    device, purpose : str
        As of `keyed_noise.uniform`.
    response : callable, optional
        Factor at frequencies (n,) by which the process, of standard deviation 1 before, is passed
        on. The same seed, device and purpose with another one is the same gust elsewhere.
    """

    def __init__(self, spectrum, slowest, fastest, seed, device, purpose, response=None):
        count = max(2, int(np.ceil(_A_DECADE * np.log10(fastest / slowest))))
        edges = np.geomspace(slowest, fastest, count + 1)
        keys = np.arange(count)
        place = keyed_noise.uniform(seed, device, f'{purpose} frequency', keys)
        self._frequency = edges[:-1] * (edges[1:] / edges[:-1]) ** place
        self._phase = 2.0 * np.pi * keyed_noise.uniform(seed, device, f'{purpose} phase', keys)
        power = spectrum(self._frequency) * np.diff(edges)
        self._amplitude = np.sqrt(2.0 * power / power.sum())
        if response is not None:
            self._amplitude = self._amplitude * response(self._frequency)

    @property
    def sigma(self):
        """Standard deviation."""
        return float(np.sqrt(0.5 * np.sum(self._amplitude**2)))

    def at(self, seconds, exposure=0.0):
        """Values at `seconds` (any shape), each the mean over `exposure` (s) about it."""
        seconds = np.asarray(seconds, dtype=float)
        amplitude = self._amplitude * np.sinc(self._frequency * exposure)
        flat = seconds.ravel()
        out = [np.cos(np.multiply.outer(flat[i:i + _CHUNK], 2.0 * np.pi * self._frequency)
                      + self._phase) @ amplitude for i in range(0, len(flat), _CHUNK)]
        return (np.concatenate(out) if out else flat).reshape(seconds.shape)


def ar_noise(correlation_time, seed, device, purpose):
    """`SlowNoise` of a first-order process: its correlation is exp(-lag / `correlation_time`)."""
    corner = 0.5 / (np.pi * correlation_time)

    def lorentzian(frequency):
        return 1.0 / (1.0 + (frequency / corner) ** 2)
    return SlowNoise(lorentzian, 1e-3 * corner, 1e3 * corner, seed, device, purpose)
