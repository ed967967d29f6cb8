"""Whether the axes follow a command while it is waited for, by their readings alone."""

import numpy as np

from msg_tools.units import ARCSEC, DEG, wrap

#: an axis must come nearer to its demand within so long, ns, by so much, rad
WITHIN, NEARER = 1_500_000_000, 5.0 * ARCSEC
#: one that swings has longer, ns
SWINGS = 6_000_000_000
#: an axis that is farther by so much than at the command went the wrong way, rad
AWAY = 1.0 * DEG


class FollowingCheck:
    """The axes and one track.

    Parameters
    ----------
    track : Track
    here : ndarray, shape (2,)
        Where the encoders stood at the command, rad.
    mount : Mount
    near : float
        A smaller distance from the demand is no fault, rad.
    """

    def __init__(self, track, here, mount, near):
        self._track, self._mount, self._near = track, mount, near
        self._here = np.array(here)
        self._first = self._least = None
        self._since = np.zeros(2, np.int64)

    def say(self, stamp, here):
        """What is wrong by a reading, '' where nothing is.

        Parameters
        ----------
        stamp : int
            ns.
        here : ndarray, shape (2,)
            rad.

        Returns
        -------
        str
        """
        track = self._track
        if not track.start <= stamp <= track.end or not np.isfinite(here).all():
            return ''
        at = (stamp - track.start) * 1e-9
        demand = np.array([np.interp(at, track.times, axis) for axis in track.angles.T])
        way = here - demand
        if self._mount.altaz:  # its reading may wrap; that of others is on the mount's travel
            way[0] = wrap(way[0])
        left = np.abs(way)
        if self._first is None:
            self._first, self._least = left, left
            self._then = self._here, way  # reading and way when it was nearest
            self._since[:] = track.start
            return self._stuck(stamp, here, demand, way)
        nearer = left < self._least - NEARER
        self._least = np.where(nearer, left, self._least)
        self._since[nearer] = stamp
        self._then = tuple(np.where(nearer, now, then)
                           for now, then in zip((here, way), self._then))
        names = self._mount.names.axes
        for axis in (0, 1):
            if left[axis] > self._first[axis] + AWAY:
                return (f'{names[axis]} moves away from its demand: reversed, or the axes are '
                        'exchanged')
        return self._stuck(stamp, here, demand, way)

    def _stuck(self, stamp, here, demand, way):
        sky = way * (np.cos(demand[1]), 1.0)
        # an axis that stands, or goes along beside its track
        still = (np.abs(wrap(here - self._then[0])) < NEARER) | (
            np.abs(way - self._then[1]) < NEARER)
        stuck = (np.abs(sky) > self._near) & (
            stamp - self._since >= np.where(still, WITHIN, SWINGS))
        if not stuck.any():
            return ''
        if np.abs(wrap(here - self._here)).max() < NEARER:
            return 'no axis has moved since the command'
        axis = int(np.argmax(np.where(stuck, np.abs(sky), 0.0)))
        return (f'{self._mount.names.axes[axis]} stays {np.abs(sky[axis]) / ARCSEC:.2g} arcsec '
                'from its demand')
