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

"""Random numbers that depend only on their purpose, never on the order of calls.

Each number is a hash of (seed, device, purpose, key), where the key identifies what is observed:
the star and the number of its exposure, the power-on, or the stamp of an encoder's sample. Stamps
are on the cycles of the mount's servo (`mount.on_cycle`). So a night is reproducible whatever the
load of the machine, even if a slew takes some microseconds more or less. The generator is
counter-based: SplitMix64 (Steele, Lea & Flood 2014, OOPSLA), applied to the key and then to the
counter.
"""

import hashlib
from functools import lru_cache

import numpy as np

_STEP, _MULTIPLY_1, _MULTIPLY_2 = map(
    np.uint64, (0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB))
_SHIFTS = tuple(np.uint64(n) for n in (30, 27, 31, 11))
#: cell with at most one pulse, ns: at 1 Hz one pulse in 200 is lost
_CELL = 10_000_000


@lru_cache(maxsize=1024)
def _stream(seed, device, purpose):
    text = f'{int(seed)}\0{device}\0{purpose}'.encode()
    return np.uint64(int.from_bytes(hashlib.blake2b(text, digest_size=8).digest(), 'little'))


def _mix(z):
    """SplitMix64 mixing; changes `z` in place."""
    z ^= z >> _SHIFTS[0]
    z *= _MULTIPLY_1
    z ^= z >> _SHIFTS[1]
    z *= _MULTIPLY_2
    z ^= z >> _SHIFTS[2]
    return z


def bits(seed, device, purpose, keys, n):
    """Random bits, 64 per number.

    Parameters
    ----------
    seed, device, purpose, keys
        See `uniform`.
    n : int
        Numbers per key.

    Returns
    -------
    ndarray of uint64, shape (number of keys, n)
    """
    keys = np.atleast_1d(np.asarray(keys, dtype=np.int64)).ravel().view(np.uint64)
    state = _mix(keys * _STEP + _stream(seed, device, purpose))
    return _mix(state[:, np.newaxis] + np.arange(1, n + 1, dtype=np.uint64) * _STEP)


def _uniform(seed, device, purpose, keys, n):
    """`n` uniform numbers per key in (0, 1), shape (number of keys, n)."""
    return ((bits(seed, device, purpose, keys, n) >> _SHIFTS[3]) + 0.5) * 2.0**-53


def uniform(seed, device, purpose, keys):
    """Uniform random numbers in (0, 1).

    Parameters
    ----------
    seed : int
        Seed of the night.
    device, purpose : str
        Instrument and purpose of the number: each pair is an independent stream.
    keys : int or array_like of int, any shape
        Stamp in nanoseconds, number of the power-on, ...

    Returns
    -------
    ndarray
        With the shape of `keys`.
    """
    return _uniform(seed, device, purpose, keys, 1).reshape(np.shape(keys))


def normal(seed, device, purpose, keys, size=None):
    """Normal random numbers of mean 0 and standard deviation 1 (Box-Muller).

    Parameters
    ----------
    seed, device, purpose, keys
        See `uniform`.
    size : int, optional
        Numbers per key, for instance one per pixel of a frame.

    Returns
    -------
    ndarray
        With the shape of `keys`, followed by `size` if given.
    """
    pairs = 1 if size is None else (size + 1) // 2
    u = _uniform(seed, device, purpose, keys, 2 * pairs)
    radius = np.sqrt(-2.0 * np.log(u[:, :pairs]))
    phase = (2.0 * np.pi) * u[:, pairs:]
    if size is None:
        return (radius * np.cos(phase)).reshape(np.shape(keys))
    out = np.concatenate([radius * np.cos(phase), radius * np.sin(phase)], axis=1)
    return out[:, :size].reshape((*np.shape(keys), size))


def pulses(seed, device, purpose, rate, begin, end):
    """Times of a Poisson process.

    Parameters
    ----------
    seed, device, purpose
        See `uniform`.
    rate : float
        Mean rate, 1/s; of two pulses within 10 ms one may be left out.
    begin, end : int
        ns; pulses after `begin`, up to and including `end`.

    Returns
    -------
    ndarray of int
        ns, increasing; the pulses in an interval do not depend on how it is divided into calls.
    """
    cells = np.arange(begin // _CELL, end // _CELL + 1)
    happens = uniform(seed, device, purpose, cells) < -np.expm1(-rate * _CELL * 1e-9)
    cells = cells[happens]
    place = uniform(seed, device, f'moment of {purpose}', cells)
    moments = cells * _CELL + (place * _CELL).astype(np.int64)
    return moments[(moments > begin) & (moments <= end)]
