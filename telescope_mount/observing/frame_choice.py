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

"""Selects camera frames, with the encoder readings around each."""

from array import array
from bisect import bisect_left
from collections import deque

import numpy as np

from msg_tools.units import wrap
from pointing_model.encoder_difference import interpolate

from .axis_demand import on_sky

#: readings older than the last by more than this belong to a new simulation, ns
CLOCK_JUMP = 1_000_000_000
#: interval before an exposure over which the axis rate is averaged, ns: two readings a tenth of a
#: second apart show stick-slip, not the rate
RATE_OVER = 1_000_000_000
ENCODERS = ('enc', 'abs')


class Readings:
    """The newest readings of an encoder, 24 bytes each.

    Attributes
    ----------
    stamps : array of int
        Nanoseconds, increasing.
    """

    def __init__(self, most=20000):
        self._most = most
        self.clear()

    def __len__(self):
        return len(self.stamps)

    def clear(self):
        """Discard all readings."""
        self.stamps, self._angles = array('q'), array('d')

    def append(self, stamp, angles):
        """Add a reading of both axes, rad."""
        if len(self.stamps) >= 2 * self._most:
            del self.stamps[:self._most], self._angles[:2 * self._most]
        self.stamps.append(stamp)
        self._angles.extend(angles)

    def since(self, stamp):
        """The newest readings, back to the last one before `stamp`.

        Returns
        -------
        stamps : ndarray of int, shape (n,)
        angles : ndarray, shape (n, 2)
        """
        first = max(bisect_left(self.stamps, stamp) - 1, 0)
        return (np.array(self.stamps[first:], np.int64),
                np.array(self._angles[2 * first:]).reshape(-1, 2))


def beside(stamps, angles, track, begin, end):
    """Readings minus the track of the mount, from `begin` to `end`.

    Parameters
    ----------
    stamps : array_like of int, shape (n,)
        ns, increasing, from before `begin` to after `end`.
    angles : array_like, shape (n, 2)
        Readings, rad.
    track : axis_demand.Track
    begin, end : int
        ns.

    Returns
    -------
    times : ndarray, shape (k,)
        Seconds since the start of the track: `begin`, the readings in between, `end`.
    way : ndarray, shape (k, 2)
        rad.
    """
    stamps = np.array(stamps, np.int64)
    at = (stamps - track.start) * 1e-9
    way = np.array(angles, float).reshape(-1, 2) - track.at(stamps)
    way[:, 0] = wrap(way[:, 0])
    edges = (np.array([begin, end]) - track.start) * 1e-9
    inside = (at > edges[0]) & (at < edges[1])
    ends = np.column_stack([np.interp(edges, at, axis) for axis in way.T])
    return (np.concatenate([edges[:1], at[inside], edges[1:]]),
            np.concatenate([ends[:1], way[inside], ends[1:]]))


def mean_over(stamps, angles, track, stamp, half):
    """Mean reading over an exposure, to match the image.

    The difference from the track is averaged, since the track is not a straight line.

    Parameters
    ----------
    stamps, angles, track
        See `beside`.
    stamp, half : int
        Mid-exposure and half its length, ns; `half` must be above 0.

    Returns
    -------
    ndarray, shape (2,)
        rad, on the turn of the middle reading.
    """
    middle, _ = interpolate(stamps, angles, stamp)
    at, way = beside(stamps, angles, track, stamp - half, stamp + half)
    mean = track.at(stamp) + np.trapezoid(way, at, axis=0) / (at[-1] - at[0])
    return middle + [wrap(mean[0] - middle[0]), mean[1] - middle[1]]


def half_of(exposure):
    """Half the length of an exposure (s), in ns."""
    return round(0.5e9 * exposure)


class Exposures:
    """Matches readings and frames since a track was commanded.

    Parameters
    ----------
    encoders : sequence of str
        Subset of `ENCODERS`: each must have readings around an exposure.

    Attributes
    ----------
    restless : list of float
        Motion of the axes relative to the track in frames on this track that were refused for
        it, rad.
    """

    def __init__(self, encoders=ENCODERS):
        self._readings = {encoder: Readings() for encoder in encoders}
        self._frames = deque(maxlen=1000)
        self._track = None
        self.restless = []

    @property
    def end(self):
        """End of the commanded track, ns; 0 without one."""
        return 0 if self._track is None else self._track.end

    def demand(self, stamp):
        """Place on the track at a stamp, rad, shape (2,); None outside it."""
        return None if self._track is None else self._track.demand(stamp)

    def begin(self, track):
        """Start with a new commanded `axis_demand.Track`; discard earlier frames."""
        self._track = track
        self._frames.clear()
        self.restless = []

    def forget(self):
        """Discard everything after a restart of the clock: earlier stamps are meaningless."""
        for readings in self._readings.values():
            readings.clear()
        self._frames.clear()
        self._track = None

    def add_reading(self, encoder, stamp, angle):
        """Add a reading.

        Returns
        -------
        bool
            Whether the clock went back, and earlier data was discarded.

        Raises
        ------
        ValueError
            The stamp is not newer than the previous one.
        """
        readings = self._readings[encoder]
        back = bool(readings) and stamp <= readings.stamps[-1]
        if back:
            if readings.stamps[-1] - stamp < CLOCK_JUMP:
                raise ValueError('stamp not after the one before: two encoders on one topic?')
            readings.clear()
        readings.append(stamp, angle)
        return back

    def add_frame(self, stamp, x, y):
        """Add a measured miss distance, rad."""
        self._frames.append((stamp, x, y))

    def at(self, encoder, stamp):
        """Angles and rates of an encoder at `stamp`; see `interpolate`.

        The absolute encoder may give one axis alone. The incremental one must give both, to point
        at a star: otherwise ValueError, as for a missing encoder.
        """
        if encoder not in self._readings:
            raise ValueError('the mount has no such encoder')
        stamps, read = self._readings[encoder].since(stamp - RATE_OVER)
        angles, rates = interpolate(stamps, read, stamp, RATE_OVER)
        if encoder == 'enc' and not np.isfinite(angles).all():
            raise ValueError('encoder reading is not a number: home the encoder')
        return angles, rates

    def over(self, encoder, stamp, exposure):
        """The same as `at`, averaged over an exposure around `stamp`, to match the image.

        Parameters
        ----------
        encoder : str
        stamp : int
            Mid-exposure, ns.
        exposure : float
            Exposure time, s.
        """
        angles, rates = self.at(encoder, stamp)
        half = half_of(exposure)
        if half:
            angles = mean_over(*self._readings[encoder].since(stamp - half), self._track, stamp,
                               half)
        return angles, rates

    def _settled(self, stamp, half, tolerance, smear):
        """Whether the axes were on target and at rest relative to it during the whole exposure."""
        _, way = beside(*self._readings['enc'].since(stamp - half), self._track,
                        stamp - half, stamp + half)
        way = way * (np.cos(self._track.at(stamp)[1]), 1.0)
        if not np.isfinite(way).all() or np.hypot(*way.T).max() > tolerance:
            return False
        moved = float(np.hypot(*np.ptp(way, axis=0)))
        if moved > smear:
            self.restless.append(moved)
        return moved <= smear

    def take(self, tolerance, refuse, exposure=0.0, smear=np.inf):
        """The next usable frame on the commanded track, with readings of both encoders around it.

        Parameters
        ----------
        tolerance : float
            Largest difference of the encoder from its demand, on the sky, rad.
        refuse : callable
            Called with the reason why a frame is unusable.
        exposure : float
            Exposure time, s: the encoder must be within `tolerance` throughout; 0: at mid-exposure.
        smear : float
            Largest motion of the axes relative to the track in that time, rad.

        Returns
        -------
        (int, ndarray) or None
            Stamp in ns and miss distance (2,) in rad; None if there is none yet.
        """
        if self._track is None:
            return None
        start, half = self._track.start, half_of(exposure)
        while self._frames:
            stamp, *miss = self._frames[0]
            if stamp >= start and not all(
                    r and r.stamps[-1] > stamp and r.stamps[-1] >= stamp + half
                    for r in self._readings.values()):
                return None
            self._frames.popleft()
            if stamp - half < max([start, *(r.stamps[0] for r in self._readings.values() if r)]):
                continue  # exposure was under way at the command
            try:
                reading, _ = self.at('enc', stamp)
            except ValueError as err:
                refuse(str(err))
                continue
            if np.hypot(*on_sky(reading, self._track.at(stamp))) <= tolerance and (
                    not half or self._settled(stamp, half, tolerance, smear)):
                return stamp, np.array(miss)
        return None
