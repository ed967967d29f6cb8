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

"""The observer's connection to the mount guard: requests, and what the guard allows."""

from msg_tools import convert, topics

from ..guard.allowed_sky import AllowedSky
from .axis_demand import Track

NO_GUARD = 'no guard is there: start mount_guard, nothing else moves the mount'
#: states of the guard that end a plan
ENDING = ('aborted', 'parking', 'parked')


class GuardLink:
    """Requests tracks, and receives the guard's status and its commands to the mount.

    Parameters
    ----------
    node : MountNode
        The observer.
    mount : Mount

    Attributes
    ----------
    known : bool
        Whether the guard has published its status.
    ends : str
        Why the guard ends the plan, '' if it does not.
    allowed : AllowedSky or None
        Where the guard lets the tube point; None if unknown.
    elsewhere : str
        Why the guard's site may differ from that of the observer, '' if it does not.
    own_way : bool
        Whether the mount slews in its own way to places that it is sent to.
    """

    def __init__(self, node, mount):
        self._node, self._mount = node, mount
        self._publisher, self._request = node.publisher(topics.REQUEST), None
        self._owner_pub = node.publisher(topics.REQUEST_OWNER)
        self.known, self.ends, self.allowed, self.own_way = False, '', None, False
        self.elsewhere = ''
        self._there, self._holds, self._refused, self._command = False, '', (0, ''), None

    def take_status(self, message, site):
        """Take a message on `guard/status`; ValueError for an invalid sky."""
        rows = {row.key: row.value for row in message.values}
        state, self.known = rows.get('state', ''), True
        self._refused = int(rows.get('refused', 0)), rows.get('reason', '')
        self.own_way = rows.get('goto') == 'True'
        self.allowed = AllowedSky.from_rows(rows, site)
        self.elsewhere = self.allowed.elsewhere if self.allowed else ''
        self.ends = f'the mount guard: {message.message}' if state in ENDING else ''
        if self.ends:
            self._request = None
        self._holds = message.message if state in ('paused', 'inactive') else ''

    def take_command(self, message):
        """Take a command of the guard to the mount."""
        self._command = Track(*convert.read_trajectory(message))

    def send_command(self, track):
        """Request a `Track`."""
        self._request = convert.trajectory(*track, self._mount.names.keys)
        self._owner_pub.publish(convert.owner(self._request, self._node))
        self._publisher.publish(self._request)

    def renew(self, wanted):
        """Repeat the last request, or withdraw it: the guard drops unrepeated requests."""
        if self._request is not None and wanted:
            self._publisher.publish(self._request)
        else:
            self.withdraw()

    def withdraw(self):
        """Withdraw the request: a track without points."""
        request, self._request = self._request, None
        if request is not None:
            request.points = request.points[:0]
            self._publisher.publish(request)

    def refusal(self, stamp):
        """Why the guard refused the track that begins at `stamp` (ns); '' if it did not."""
        refused, reason = self._refused
        return reason if refused == stamp else ''

    def sent(self, stamp):
        """Where the guard sent the mount at `stamp` (ns), rad, shape (2,); None if unknown."""
        return None if self._command is None else self._command.at(stamp)

    def lacking(self):
        """What a plan must wait for before it begins, list of str."""
        if not self.known:
            return ['the guard to say whether the mount may move']
        return [f'one site: {self.elsewhere}'] if self.elsewhere else []

    def held(self):
        """Why the mount may not be moved now; '' if it may."""
        if not self._there:
            self.look()
        return self._holds if self._there else NO_GUARD

    def look(self):
        """Update whether a guard is present: it publishes its status."""
        self._there = self._node.publisher_count(topics.GUARD_STATUS) > 0
