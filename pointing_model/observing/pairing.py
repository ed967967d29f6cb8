"""One observation from what the instruments sent: encoder readings and a miss distance."""

from collections import deque

import numpy as np

from msg_tools.units import wrap

#: readings older than the last by this are of a new simulation, ns
CLOCK_JUMP = 1_000_000_000
#: before and after an exposure, over which the rate of an axis is taken, ns
_HALF = 500_000_000
ENCODERS = ('enc', 'abs')


def interpolate(stamps, angles, stamp):
    """The angles at `stamp`, between the readings beside it.

    Parameters
    ----------
    stamps : array_like of int, shape (n,)
        Nanoseconds, increasing.
    angles : array_like, shape (n, 2)
        Azimuth and elevation, rad.
    stamp : int
        Within the range of `stamps`.

    Returns
    -------
    angles : ndarray, shape (2,)
        Radians; NaN where an axis gave none.
    rates : ndarray, shape (2,)
        Mean over the second about `stamp`, as far as there are readings, rad/s.

    Raises
    ------
    ValueError
        No reading on one side of `stamp`.
    """
    stamps = np.asarray(stamps, dtype=np.int64)
    angles = np.asarray(angles, dtype=float).reshape(-1, 2)
    i = int(np.searchsorted(stamps, stamp, side='left'))
    if i < len(stamps) and stamps[i] == stamp and i == 0:
        i = 1
    if i == 0 or i >= len(stamps):
        raise ValueError('no encoder readings on both sides of the exposure')
    low, high = angles[i - 1], angles[i]
    span = float(stamps[i] - stamps[i - 1])
    step = np.array([wrap(high[0] - low[0]), high[1] - low[1]])
    # over a second: two readings a tenth of a second apart show a slip, not how the axis moves
    first, last = np.searchsorted(stamps, [stamp - _HALF, stamp + _HALF + 1])
    first, last = min(first, i - 1), max(last - 1, i)
    way = np.array([wrap(angles[last, 0] - angles[first, 0]), angles[last, 1] - angles[first, 1]])
    rate = way / (float(stamps[last] - stamps[first]) * 1e-9)
    return low + step * (float(stamp - stamps[i - 1]) / span), rate


def centred(az, el, miss_x, miss_y):
    """The encoder reading that would have put the star on the boresight.

    The miss distance is a point in the tangent plane about the pointing; taking it back to the
    sphere exactly keeps stars near the zenith right.

    Parameters
    ----------
    az, el : float or ndarray
        Encoder reading, rad.
    miss_x, miss_y : float or ndarray
        Star minus boresight toward +A and +E, rad.

    Returns
    -------
    az, el : float or ndarray
        Radians.
    """
    up = np.cos(el) - miss_y * np.sin(el)
    new_az = az + np.arctan2(miss_x, up)
    return new_az, np.arctan2(np.sin(el) + miss_y * np.cos(el), np.hypot(miss_x, up))


class Exposures:
    """Readings and frames since a track was commanded, and which of them belong together."""

    def __init__(self):
        self._readings = {encoder: deque(maxlen=20000) for encoder in ENCODERS}
        self._frames = deque(maxlen=1000)
        self._track = None

    @property
    def end(self):
        """Of the commanded track, ns; 0 without one."""
        return 0 if self._track is None else self._track[0] + round(self._track[1][-1] * 1e9)

    def begin(self, start, times, track):
        """Forget what was before: a track is commanded.

        Parameters
        ----------
        start : int
            ns.
        times : ndarray, shape (n,)
            Seconds since `start`.
        track : ndarray, shape (n, 2)
            Encoder angles demanded then, rad.
        """
        self._track = start, times, track
        self._frames.clear()
        for readings in self._readings.values():
            readings.clear()

    def add_reading(self, encoder, stamp, angle):
        """Take a reading.

        Returns
        -------
        bool
            The clock went back, and what was before is forgotten.

        Raises
        ------
        ValueError
            It is not newer than the one before.
        """
        readings = self._readings[encoder]
        back = bool(readings) and stamp <= readings[-1][0]
        if back:
            if readings[-1][0] - stamp < CLOCK_JUMP:
                raise ValueError('stamp not after the one before: two encoders on one topic?')
            readings.clear()
        readings.append((stamp, angle))
        return back

    def add_frame(self, stamp, x, y):
        """Take a measured miss distance, rad."""
        self._frames.append((stamp, x, y))

    def at(self, encoder, stamp):
        """Angles and rates of an encoder at `stamp`; see `interpolate`.

        The absolute encoder may give one axis alone; without both of the incremental one no star
        can be pointed at: ValueError.
        """
        readings = self._readings[encoder]
        angles, rates = interpolate([s for s, _ in readings], [a for _, a in readings], stamp)
        if encoder == 'enc' and not np.isfinite(angles).all():
            raise ValueError('encoder reading is not a number: home the encoder')
        return angles, rates

    def take(self, tolerance, refuse):
        """The next frame on the commanded track that has readings of both encoders around it.

        Parameters
        ----------
        tolerance : float
            Largest difference of the encoder from its demand, on the sky, rad.
        refuse : callable
            Called with the reason for a frame that cannot be used.

        Returns
        -------
        (int, ndarray) or None
            Stamp in ns and miss distance (2,) in rad; None where there is none yet.
        """
        start, times, track = self._track
        while self._frames:
            stamp, *miss = self._frames[0]
            if stamp >= start and not all(
                    r and r[-1][0] > stamp for r in self._readings.values()):
                return None
            self._frames.popleft()
            if stamp < max([start, *(r[0][0] for r in self._readings.values() if r)]):
                continue  # under way when the command came
            try:
                reading, _ = self.at('enc', stamp)
            except ValueError as err:
                refuse(str(err))
                continue
            t = (stamp - start) * 1e-9
            wanted = [np.interp(t, times, axis) for axis in track.T]
            error = wrap(reading[0] - wanted[0]) * np.cos(wanted[1]), reading[1] - wanted[1]
            if np.hypot(*error) <= tolerance:
                return stamp, np.array(miss)
        return None
