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

"""Common parts of the nodes of simulated devices: parameters, scenario, start of the night."""

from msg_tools import convert, topics
from msg_tools.iso_time import iso_seconds
from msg_tools.node import MountNode, Param

from .scenario_file import load_scenario

#: end of the seconds of builtin_interfaces/Time (int32), minus a day for the night itself
LAST_SECOND = 2**31 - 86400


def parse_utc(text):
    """Nanoseconds since 1970 of an ISO 8601 date, UTC by default.

    Raises
    ------
    ValueError
        Not a date, or outside the range of ROS time messages.
    """
    seconds = round(iso_seconds(text))
    if not 0 < seconds < LAST_SECOND:
        raise ValueError(f'{text!r}: ROS messages hold times from 1970 to 2038-01-18 only')
    return seconds * 1_000_000_000


DEVICE_PARAMS = (
    Param('scenario', 'default', 'what is wrong with the mount: a name or a YAML file',
          check=load_scenario, fixed=True, truth=True),
    Param('seed', 1, 'seed of every random number of the night', 0, 2**31 - 1, fixed=True,
          truth=True),
    Param('start_time', '2026-01-15T13:00:00', 'UTC at which the night begins, ISO 8601; drifts '
          'count from it', check=parse_utc, fixed=True),
)
MAX_RATE = Param(
    'max_rate_hz', 0.0, 'most readings a second of simulated time; 0: one for every true angle '
    '[Hz]', 0.0, 2000.0)


class MountedDevice(MountNode):
    """A device on the mount, which receives the true angles of its axes.

    Attributes
    ----------
    scenario : scenario.Scenario
    names : tuple of str
        Joint names of the axes.
    words : tuple of str
        Names of the axes for people.
    start : int
        Start of the night, ns.
    """

    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        self.scenario = load_scenario(self.value('scenario'))
        self.names, self.words = self.scenario.mount.names.keys, self.scenario.mount.names.axes
        self.start = parse_utc(self.value('start_time'))

    def encoders(self, kind, pair, **where):
        """An encoder of `kind` for each axis, with the parameters of `pair` in the scenario."""
        return [kind(getattr(pair, axis), self.value('seed'), name, start=self.start * 1e-9,
                     **where) for axis, name in zip(convert.AXES, self.names)]

    def warmth(self, stamps, behind=0.0):
        """Temperature of mount and encoders at `stamps` (ns), degC; `behind`: time constant, s."""
        return self.scenario.temperature(stamps * 1e-9, self.start * 1e-9, behind)

    def required(self):
        """Requires the mount."""
        return {self.resolve_topic_name(topics.TRUTH_JOINTS.name)}


class Decimator:
    """Passes a sample if at least 1/rate has elapsed since the last one passed."""

    def __init__(self):
        self._last = None

    def passes(self, stamp, rate):
        """Whether the sample at `stamp` (ns) is due at `rate` (Hz; 0: always)."""
        if rate > 0.0 and self._last is not None and 0 <= stamp - self._last < 1e9 / rate - 1:
            return False
        self._last = stamp
        return True
