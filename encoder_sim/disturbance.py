"""What disturbs an encoder's electronics and its messages at moments of their own.

All of it is keyed by the stamp or by the time, so that it does not depend on what is read together.
"""

import numpy as np

from . import keyed_noise

#: in which at most one disturbance happens, ns: of 1 Hz one in 200 is lost
_CELL = 10_000_000


def stamp_delays(params, seed, device, stamps):
    """By how much the stamp of a message is later than its reading, beside the mean latency.

    Parameters
    ----------
    params : scenario_encoders.EncoderScale
        Of an axis.
    seed : int
    device : str
        Name of the encoder, without axis: both axes are in one message.
    stamps : ndarray of int, shape (n,)
        ns.

    Returns
    -------
    float or ndarray, shape (n,)
        s: white, with mean 0, and in a share of the messages an exponential delay on top.
    """
    delay = 0.0
    if params.stamp_jitter > 0.0:
        delay = params.stamp_jitter * keyed_noise.normal(seed, device, 'stamp jitter', stamps)
    if params.late_stamps > 0.0:
        late = keyed_noise.uniform(seed, device, 'late stamps', stamps) < params.late_stamps
        delay = delay - late * params.late_by * np.log(
            keyed_noise.uniform(seed, device, 'how late', stamps))
    return delay


def pulses(seed, device, purpose, rate, begin, end):
    """Moments of a Poisson process.

    Parameters
    ----------
    seed, device, purpose
        As for `keyed_noise.uniform`.
    rate : float
        Mean number a second, 1/s; of two within 10 ms one is left out.
    begin, end : int
        ns; pulses after `begin`, up to and with `end`.

    Returns
    -------
    ndarray of int
        ns, rising; a stretch of time has the same ones, whatever it is a part of.
    """
    cells = np.arange(begin // _CELL, end // _CELL + 1)
    happens = keyed_noise.uniform(seed, device, purpose, cells) < -np.expm1(-rate * _CELL * 1e-9)
    cells = cells[happens]
    place = keyed_noise.uniform(seed, device, f'moment of {purpose}', cells)
    moments = cells * _CELL + (place * _CELL).astype(np.int64)
    return moments[(moments > begin) & (moments <= end)]
