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

"""Result of a reader of orbit files, and its declaration."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from .ephemeris import BAD, Arc
from .time_scales import utc_text

#: least interpolation error of a coordinate that is reported, m
COARSE = 0.3
#: typical error of a coordinate in files without it, m: of an orbit fitted to data; of predictions:
#: upper limit of the orbit's radius (low satellites, then high ones), error on the first day, and
#: growth per day. Predictions for one satellite by several providers differ by 40 to 420 m.
FITTED = 0.1
PREDICTED = ((8.4e6, 60.0, 120.0), (np.inf, 20.0, 20.0))


@dataclass
class ObjectRows:
    """Positions of one satellite in a file.

    Attributes
    ----------
    name : str
        ``G18``, ``L52``, ``lageos2``.
    other_names : tuple of str
        Additional names: catalogue numbers.
    lines : ndarray of int, shape (n,)
        Line numbers in the file.
    whole, rest : ndarray, shape (n,)
        TAI, whole seconds since 1970-01-01, and the fraction.
    places : ndarray, shape (n, 3)
        ITRF, m; NaN: none.
    rates : ndarray, shape (n, 3), or None
        m/s.
    sigmas : ndarray, shape (n,)
        m; NaN: unknown.
    provider : str
    predicted : bool
    issued : float or None
        TAI from which the error of a prediction grows; None: its first epoch.
    count : int
        Points of a polynomial; 0: chosen by the step.
    """

    name: str
    lines: np.ndarray
    whole: np.ndarray
    rest: np.ndarray
    places: np.ndarray
    rates: np.ndarray | None = None
    sigmas: np.ndarray | None = None
    provider: str = ''
    predicted: bool = False
    issued: float | None = None
    count: int = 0
    other_names: tuple = field(default_factory=tuple)

    def arcs(self, path, notes):
        """Arcs of the rows, a list of `Arc`; adds what was left out to `notes`.

        Raises
        ------
        ValueError
            Epochs are not in order, or fewer than two remain.
        """
        good = np.isfinite(self.places).all(axis=1) & np.any(self.places != 0.0, axis=1)
        if good.sum() < 2:
            raise ValueError(f'{path}: {self.name} has {good.sum()} positions; an orbit needs two '
                             'at least: take another file')
        keep = np.flatnonzero(good)
        if len(keep) < len(good):
            notes.append(f'{path}: {self.name} has no position at {len(good) - len(keep)} epochs, '
                         f'the first in line {self.lines[np.flatnonzero(~good)[0]]}')
        whole, rest = self.whole[keep], self.rest[keep]
        origin = float(whole[0])
        epochs = (whole - origin) + rest
        late = np.flatnonzero(np.diff(epochs) <= 0.0)
        if len(late):
            first = late[0] + 1
            raise ValueError(f'{path}, line {self.lines[keep[first]]}: the epoch '
                             f'{utc_text(whole[first])} of {self.name} is not after the one before:'
                             ' sort the file, or give its parts as files')
        arc = Arc(origin, epochs, self.places[keep], None if self.rates is None else self._rates(
            keep), self._sigmas(keep, origin + epochs), str(path), self.provider, self.count)
        return [part for one in arc.parts() for part in [_sound(one, path, self, notes)]]

    def _rates(self, keep):
        rates = self.rates[keep]
        return rates if np.isfinite(rates).all() and np.any(rates != 0.0, axis=1).all() else None

    def _sigmas(self, keep, tai):
        default = np.full(len(tai), FITTED)
        if self.predicted:
            radius = float(np.median(np.linalg.norm(self.places[keep], axis=1)))
            first, growth = next(one[1:] for one in PREDICTED if radius < one[0])
            issued = tai[0] if self.issued is None else self.issued
            default = first + growth * np.maximum(tai - issued, 0.0) / 86400.0
        if self.sigmas is None:
            return default
        given = self.sigmas[keep]
        return np.where(np.isfinite(given) & (given > 0.0), given, default)


def _sound(arc, path, rows, notes):
    """The arc without outlying epochs, with its own roughness as least sigma."""
    while True:
        off, expected = arc.roughness()
        # next to a bad epoch no reliable deviation is expected
        beyond = np.where(expected < BAD, off, 0.0)
        if not len(off) or beyond.max() < BAD:
            break
        worst = int(np.argmax(beyond))
        notes.append(f'{path}: the position of {rows.name} at '
                     f'{utc_text(arc.origin + arc.epochs[worst])} UTC is {beyond.max() / 1e3:.3g} '
                     'km off its neighbours, and left out')
        arc = arc.without(worst)
        if len(arc.epochs) < 2 * len(rows.whole) // 3:
            raise ValueError(f'{path}: the positions of {rows.name} lie on no orbit: is a '
                             'coordinate missing, or the step wrong?')
    if len(off) < arc.width + 1:
        return arc
    inner = np.arange(arc.width // 2, len(off) - arc.width // 2)
    off, expected = off[inner], expected[inner]
    half = arc.width // 2
    middle = 0.5 * (arc.epochs[half - 1:-half] + arc.epochs[half:arc.epochs.size - half + 1])
    coarse = float(arc.between(middle).max())
    if coarse > COARSE:
        notes.append(f'{path}: epochs of {rows.name} are too far apart, {arc.step / 60.0:.0f} min, '
                     f'for its orbit: interpolation error {coarse:.1f} m; take a denser file')
        return arc
    if off.max() > max(0.1, 30.0 * float(np.median(off)), 5.0 * float(expected.max())):
        at = arc.origin + arc.epochs[inner[np.argmax(off)]]
        notes.append(f'{path}: the orbit of {rows.name} itself jumps, by {off.max():.2f} m at '
                     f'{utc_text(at)} UTC')
    own = float(np.median(np.sqrt(np.maximum(off**2 - (2.0 * expected)**2, 0.0))))
    arc.sigmas[:] = np.maximum(arc.sigmas, own / np.sqrt(3.0))
    return arc


@dataclass(frozen=True)
class OrbitFormat:
    """A format of orbit files.

    Attributes
    ----------
    wording : str
        Name for people.
    looks_like : callable
        Lines -> bool.
    read : callable
        Path, lines -> list of `ObjectRows`, or of `elements.Satellite`.
    """

    wording: str
    looks_like: Callable
    read: Callable


def number(text, path, line, what):
    """Number from a file; ValueError with one line for people if it is invalid."""
    try:
        return float(text)
    except ValueError:
        cut = '' if text.strip() else '; is the file cut off here?'
        raise ValueError(f'{path}, line {line}: {text.strip()!r} is no {what}{cut}') from None
