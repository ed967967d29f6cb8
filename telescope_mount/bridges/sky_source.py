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

"""Where a node gets the sky that is seen from, whatever protocol its server speaks."""

from collections import deque

from .reconnection import Reconnection


class SkySource:
    """Finds what it needs, in its own thread.

    Parameters
    ----------
    field : StarField
    where : str
        Host and port, for people.

    Attributes
    ----------
    on : bool
        Whether exposures are wanted; a camera is left alone where not.
    exposures : deque of (int, ndarray)
        Stamp (ns) and miss distance (rad; NaN: no star) of each exposure.
    why : str
        What is missing; '' while all is well.
    note : str
        What is odd, though exposures come.
    """

    def __init__(self, field, where):
        self.field, self.where, self.exposures, self.on = field, where, deque(maxlen=100), True
        self.why, self.note = f'connecting to {where}', ''
        self._reconnection = Reconnection(self.work, self._failed)

    def start(self):
        """Begin; returns at once."""
        self._reconnection.start()

    def close(self):
        """End it."""
        self._reconnection.close()

    def switch(self, on):
        """Begin with exposures, or end with them."""
        self.on = on
        self.exposures.clear()
        self._reconnection.wake()

    def take_axes(self, second):
        """Angle of the second axis, rad, for who does not hear it itself."""

    def lose(self):
        """The connection is lost."""

    def work(self):
        """Find what is needed, and with a camera: expose; BridgeError where that fails."""
        raise NotImplementedError

    def _failed(self, why):
        self.why = why
