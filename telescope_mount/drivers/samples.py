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

"""Recorded data of drivers, and remarks on them."""

from dataclasses import dataclass, field
from functools import partialmethod
from typing import NamedTuple

import numpy as np

from msg_tools.units import ARCSEC, DEG

OK, NOTE, WRONG = 'ok', 'note', 'wrong'


class Remark(NamedTuple):
    """A remark: severity (`OK`, `NOTE`, `WRONG`), topic or service, and sentence."""

    level: str
    of: str
    text: str


class Remarks(list):
    """List of `Remark` on one topic; ``ok(text)``, ``note(text)``, ``wrong(text)`` add one.

    Parameters
    ----------
    of : str
        Name of a topic or a service.
    """

    def __init__(self, of):
        super().__init__()
        self.of = of

    def add(self, level, text):
        """Add a remark."""
        self.append(Remark(level, self.of, text))

    ok = partialmethod(add, OK)
    note = partialmethod(add, NOTE)
    wrong = partialmethod(add, WRONG)


class Endpoint(NamedTuple):
    """A publisher or subscriber in the graph."""

    node: str
    type: str
    reliable: bool = True
    latched: bool = False


def wrong_unit(ratio, words):
    """`words` with the unit that explains a factor `ratio` to radians, '' if there is none."""
    return next((words.format(unit) for unit, size in (('arcsec', ARCSEC), ('deg', DEG))
                 if 0.5 < ratio * size < 2.0), '')


@dataclass
class Stream:
    """A topic and the messages received on it.

    Parameters
    ----------
    topic, type : str
        Name, and the required type.
    endpoints : list of Endpoint
        Its publishers.
    arrived, stamps : list of float
        Times of each message, s: of reception by this machine's clock, and its stamp.
    ages : list of float
        Time of the graph at reception minus stamp, s.
    names : list of sequence of str
        Joint names of each message; empty if it has none.
    values, rates : list of (float, float)
        First and second axis, or x and y, as received.
    power_ons : list of PowerOn or None
        Power-on of each message.
    refused : list of str
        Why messages could not be read at all.
    frames : set of str
        ``frame_id`` of the messages.
    """

    topic: str
    type: str
    endpoints: list = field(default_factory=list)
    arrived: list = field(default_factory=list)
    ages: list = field(default_factory=list)
    stamps: list = field(default_factory=list)
    names: list = field(default_factory=list)
    values: list = field(default_factory=list)
    rates: list = field(default_factory=list)
    power_ons: list = field(default_factory=list)
    refused: list = field(default_factory=list)
    frames: set = field(default_factory=set)

    def take(self, arrived, stamp, values, rates=(np.nan, np.nan), names=(), power_on=None,
             now=None):
        """Add a message; `now` is the time of the graph, by default that of this machine."""
        self.arrived.append(arrived)
        self.ages.append((arrived if now is None else now) - stamp)
        self.stamps.append(stamp)
        self.values.append(tuple(values))
        self.rates.append(tuple(rates))
        self.names.append(tuple(names))
        self.power_ons.append(power_on)

    def arrays(self):
        """Stamps (n,), values (n, 2), rates (n, 2); only messages with increasing stamps."""
        stamps = np.array(self.stamps, float)
        keep = np.ones(len(stamps), bool)
        if len(stamps):
            keep[1:] = stamps[1:] > np.maximum.accumulate(stamps)[:-1]
        return (stamps[keep], np.array(self.values, float).reshape(-1, 2)[keep],
                np.array(self.rates, float).reshape(-1, 2)[keep])


@dataclass
class DriverSamples:
    """Everything recorded from a graph.

    Parameters
    ----------
    mount : Mount
    seconds : float
        Duration of the recording.
    incremental, absolute, camera : Stream
    services : set of str
        Relative names.
    followers : list of Endpoint
        Subscribers of `command` that are drivers.
    homing : bool
        Whether `incremental/homing` is published.
    clock : bool
        Whether somebody publishes `/clock`.
    clock_speed : float
        Seconds of `/clock` per second of this machine: a delayed tick lags by so much more.
    elsewhere : list of str
        Topics of instruments in other namespaces.
    nowhere : str
        What to do if there are no nodes at all, '; ...'; '' if there are some.
    """

    mount: object
    seconds: float
    incremental: Stream
    absolute: Stream
    camera: Stream
    services: set = field(default_factory=set)
    followers: list = field(default_factory=list)
    homing: bool = False
    clock: bool = False
    clock_speed: float = 1.0
    elsewhere: list = field(default_factory=list)
    nowhere: str = ''


class Rest(NamedTuple):
    """An interval of a nudge with the axes at rest: from, to (UTC s), demand (2,), rad."""

    begin: float
    end: float
    demand: np.ndarray
