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

"""Checks from their readings alone whether the axes follow a command."""

import numpy as np

from msg_tools.units import ARCSEC, DEG, wrap

#: an axis must get closer to its demand within this time, s, by this amount, rad. This holds in
#: graph time and wall time: simulated time may run fast, while messages take as long as ever
WITHIN, NEARER = 1.5, 5.0 * ARCSEC
#: time allowed for an axis that oscillates, s
SWINGS = 6.0
#: an axis farther off by this than at the command, in this many consecutive checks, moves the wrong
#: way, rad: news of what it was sent may arrive later than its readings
AWAY, LOOKS = 1.0 * DEG, 2


class FollowingCheck:
    """Checks the axes against one track.

    Parameters
    ----------
    track : Track
    here : ndarray, shape (2,)
        Encoder angles at the command, rad.
    mount : Mount
    near : float
        Smaller distances from the demand are not a fault, rad.
    own_way : bool
        The mount is sent to places and slews in its own way: one axis at a time, with pauses.
    since : float
        Wall time of the command, s.
    """

    def __init__(self, track, here, mount, near, own_way=False, since=0.0):
        self._track, self._mount, self._near, self._own = track, mount, near, own_way
        self._here = np.array(here)
        self._first = self._least = None
        #: last progress of each axis, s: graph time since the start of the track, and wall time
        self._since = np.tile((0.0, since), (2, 1))
        self._sent = None
        self._away, self._stamp = np.zeros(2, int), 0  # consecutive checks with an axis away

    def fault(self, stamp, here, wall, sent=None):
        """Fault shown by a reading, '' if none.

        Parameters
        ----------
        stamp : int
            ns.
        here : ndarray, shape (2,)
            rad.
        wall : float
            On the clock of `since`, s.
        sent : ndarray, shape (2,), optional
            Where the mount was sent at that moment, rad: it may have to go around an obstacle, or
            the long way because of its cables.

        Returns
        -------
        str
        """
        track = self._track
        if not track.start <= stamp <= track.end or not np.isfinite(here).all():
            return ''
        at = (stamp - track.start) * 1e-9
        now = at, wall
        demand = track.at(stamp)
        way = here - demand
        if self._mount.vertical:  # azimuth may wrap; other mounts read within their travel
            way[0] = wrap(way[0])
        left = np.abs(way)
        if self._first is None:
            self._first, self._least = left, left
            self._since[np.abs(wrap(here - self._here)) > NEARER] = now
            self._then = self._here, way  # reading and difference at closest approach
            self._sent = None if sent is None else (here, sent)
            return self._stuck(now, here, demand, way)
        if self._own:
            # neither standing nor moving parallel to the track
            goes = (np.abs(wrap(here - self._then[0])) > NEARER) & (
                np.abs(way - self._then[1]) > NEARER)
            if goes.any():
                self._then, self._since[:] = (here, way), now
            return self._stuck(now, here, demand, way)
        # the axis itself must have moved: a demand approaching a standing axis does not count
        nearer = (left < self._least - NEARER) & (np.abs(wrap(here - self._then[0])) > NEARER)
        self._least = np.where(nearer, left, self._least)
        self._since[nearer] = now
        self._then = tuple(np.where(nearer, now, then)
                           for now, then in zip((here, way), self._then))
        as_sent = self._as_sent(here, demand, sent)
        self._since[as_sent] = now
        if stamp > self._stamp:  # otherwise the same reading
            self._away = np.where((left > self._first + AWAY) & ~as_sent, self._away + 1, 0)
        self._stamp = stamp
        if self._away.max() >= LOOKS:
            return (f'{self._mount.names.axes[int(np.argmax(self._away))]} moves away from its '
                    'demand: reversed, or the axes are exchanged')
        return self._stuck(now, here, demand, way)

    def _as_sent(self, here, demand, sent):
        """Axes that go where they are sent if that is not yet their demand, shape (2,)."""
        if sent is None:
            return np.zeros(2, bool)
        before, self._sent = self._sent or (here, sent), (here, sent)
        there, moved = np.abs(wrap(sent - demand)) < self._near, np.abs(here - before[0])
        still = np.abs(sent - before[1]) < NEARER
        off = np.abs(wrap(here - sent))
        # a driver that is sent to places is sent far ahead at once
        comes = off < np.abs(wrap(before[0] - sent)) - NEARER
        return ~there & (comes | ((off < AWAY) & (still | (moved > NEARER))))

    def _stuck(self, now, here, demand, way):
        sky = way * (np.cos(demand[1]), 1.0)
        # an axis that stands, or moves parallel to its track
        still = (np.abs(wrap(here - self._then[0])) < NEARER) | (
            np.abs(way - self._then[1]) < NEARER)
        stuck = (np.abs(sky) > self._near) & (
            (np.array(now) - self._since).min(axis=1)
            >= np.where(still & (not self._own), WITHIN, SWINGS))
        if not stuck.any():
            return ''
        if np.abs(wrap(here - self._here)).max() < NEARER:
            return 'no axis has moved since the command'
        axis = int(np.argmax(np.where(stuck, np.abs(sky), 0.0)))
        return (f'{self._mount.names.axes[axis]} stays {np.abs(sky[axis]) / ARCSEC:.2g} arcsec '
                'from its demand')
