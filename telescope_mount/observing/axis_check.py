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

"""Whether the axes follow a command while it is waited for, by their readings alone."""

import numpy as np

from msg_tools.units import ARCSEC, DEG, wrap

#: an axis must come nearer to its demand within so long, s, by so much, rad; of the graph's time
#: and of the wall's: simulated time may pass quickly, and messages and looks take as long as ever
WITHIN, NEARER = 1.5, 5.0 * ARCSEC
#: one that swings has longer, s
SWINGS = 6.0
#: an axis that is farther by so much than at the command, at so many looks in a row, went the wrong
#: way, rad: what it was sent may be heard of later than how it moves
AWAY, LOOKS = 1.0 * DEG, 2


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
    own_way : bool
        The mount is sent places, and slews to them as it likes: axis after axis, with rests.
    since : float
        When it was commanded, s of the wall.
    """

    def __init__(self, track, here, mount, near, own_way=False, since=0.0):
        self._track, self._mount, self._near, self._own = track, mount, near, own_way
        self._here = np.array(here)
        self._first = self._least = None
        #: of each axis, s: by the graph's time since the track began, and by the wall's
        self._since = np.tile((0.0, since), (2, 1))
        self._sent = None
        self._away, self._stamp = np.zeros(2, int), 0  # looks in a row at which an axis was

    def fault(self, stamp, here, wall, sent=None):
        """What is wrong by a reading, '' where nothing is.

        Parameters
        ----------
        stamp : int
            ns.
        here : ndarray, shape (2,)
            rad.
        wall : float
            Of the clock of `since`, s.
        sent : ndarray, shape (2,), optional
            Where the mount was sent at that moment, rad: it may have to go around something, or
            the longer way because of its cables.

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
        if self._mount.vertical:  # its reading may wrap; that of others is on the mount's travel
            way[0] = wrap(way[0])
        left = np.abs(way)
        if self._first is None:
            self._first, self._least = left, left
            self._since[np.abs(wrap(here - self._here)) > NEARER] = now
            self._then = self._here, way  # reading and way when it was nearest
            self._sent = None if sent is None else (here, sent)
            return self._stuck(now, here, demand, way)
        if self._own:
            # neither standing nor going along beside the track
            goes = (np.abs(wrap(here - self._then[0])) > NEARER) & (
                np.abs(way - self._then[1]) > NEARER)
            if goes.any():
                self._then, self._since[:] = (here, way), now
            return self._stuck(now, here, demand, way)
        # of its own: a demand that comes toward an axis that stands gives nothing
        nearer = (left < self._least - NEARER) & (np.abs(wrap(here - self._then[0])) > NEARER)
        self._least = np.where(nearer, left, self._least)
        self._since[nearer] = now
        self._then = tuple(np.where(nearer, now, then)
                           for now, then in zip((here, way), self._then))
        as_sent = self._as_sent(here, demand, sent)
        self._since[as_sent] = now
        if stamp > self._stamp:  # else it is the same reading
            self._away = np.where((left > self._first + AWAY) & ~as_sent, self._away + 1, 0)
        self._stamp = stamp
        if self._away.max() >= LOOKS:
            return (f'{self._mount.names.axes[int(np.argmax(self._away))]} moves away from its '
                    'demand: reversed, or the axes are exchanged')
        return self._stuck(now, here, demand, way)

    def _as_sent(self, here, demand, sent):
        """Axes that go where they are sent, which is not yet their demand, shape (2,)."""
        if sent is None:
            return np.zeros(2, bool)
        before, self._sent = self._sent or (here, sent), (here, sent)
        there, moved = np.abs(wrap(sent - demand)) < self._near, np.abs(here - before[0])
        still = np.abs(sent - before[1]) < NEARER
        off = np.abs(wrap(here - sent))
        # a driver that is sent places is sent far ahead at once
        comes = off < np.abs(wrap(before[0] - sent)) - NEARER
        return ~there & (comes | ((off < AWAY) & (still | (moved > NEARER))))

    def _stuck(self, now, here, demand, way):
        sky = way * (np.cos(demand[1]), 1.0)
        # an axis that stands, or goes along beside its track
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
