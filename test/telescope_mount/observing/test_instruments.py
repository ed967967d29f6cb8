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

"""Which power-on a reading is of, and who has fallen silent."""

import numpy as np
import pytest

from msg_tools.power_on import PowerOn
from telescope_mount.observing.axis_demand import Track
from telescope_mount.observing.instruments import MOUNT, Instruments

HERE, LOST = (1.0, 0.5), (np.nan, np.nan)


class Encoder:

    def __init__(self, first_run=1):
        self.instruments, self.stamp = Instruments(first_run), 0

    def __call__(self, angle=HERE, number=None, started=None):
        """Number of the run after a reading."""
        self.stamp += 10**9
        power_on = None if number is None else PowerOn(number, started)
        self.instruments.take_incremental(self.stamp, angle, (0.0, 0.0), power_on)
        return self.instruments.run


def test_each_power_on_that_the_encoder_tells_is_a_run():
    read = Encoder(first_run=7)
    assert [read(LOST, 1, 10.0), read(HERE, 1, 10.0), read(HERE, 1, 10.0)] == [6, 7, 7]
    # a reading that is no number is no power-on, but a fault
    assert not read.instruments.health.sentences
    assert [read(LOST, 1, 10.0), read(HERE, 1, 10.0)] == [7, 7]
    assert 'no number, although it was homed' in [*read.instruments.health.sentences.values()][0]
    assert [read(LOST, 2, 60.0), read(HERE, 2, 60.0)] == [7, 8]
    # its driver was started anew, and counts from 1 again
    assert read(HERE, 1, 90.0) == 9
    assert read(HERE, 2, 60.0) == 8
    assert read(HERE, 2, 99.0) == 10


def test_an_encoder_that_tells_no_rate_is_at_rest_when_its_readings_are():
    read, unknown = Instruments(), (np.nan, np.nan)
    read.take_incremental(10**9, LOST, unknown)
    read.take_incremental(2 * 10**9, (6.28, 0.5), unknown)
    assert not read.homed_since(0)  # one reading tells nothing
    read.take_incremental(3 * 10**9, (0.01, 0.5), unknown)
    assert not read.homed_since(0) and abs(read.rate[0] - 0.0132) < 1e-3
    read.take_incremental(4 * 10**9, (0.01, 0.5), unknown)
    assert read.homed_since(0)
    read.take_incremental(5 * 10**9, (0.01, 0.5), (0.02, np.nan))
    assert not read.homed_since(0)


def test_a_power_on_that_is_said_late_is_that_of_the_readings_before():
    read = Encoder()
    assert [read(LOST), read(), read(HERE, 1, 1.5), read(HERE, 1, 1.5)] == [0, 1, 1, 1]
    assert read.instruments.power_on == (1, 1.5)
    other = Encoder()
    assert [other(LOST), other(), other(HERE, 2, 2.5)] == [0, 1, 2]  # it began since


def test_the_power_on_of_the_absolute_encoder_is_no_run():
    read = Encoder()
    assert read(HERE, 1, 10.0) == 1 and read.instruments.absolute_power_on is None
    for number, started in ((1, 10.0), (2, 60.0)):
        read.instruments.take_absolute(int(started) * 10**9, HERE, PowerOn(number, started))
        assert read.instruments.absolute_power_on == (number, started)
    assert read(HERE, 1, 10.0) == 1
    read.instruments.take_absolute(70 * 10**9, HERE)  # a driver that tells none
    assert read.instruments.absolute_power_on is None


def test_where_it_tells_nothing_each_homing_is_a_run():
    read = Encoder()
    assert [read(LOST), read(), read(), read(LOST), read()] == [0, 1, 1, 1, 2]


def test_an_observer_started_anew_goes_on_with_the_numbers_of_the_night():
    read = Encoder()
    assert read(HERE, 2, 60.0) == 1
    read.instruments.remember_runs([1, 1, 2, 2], [10.0, 10.0, 60.0, 60.0])
    assert read.instruments.run == read(HERE, 2, 60.0) == 2
    assert read(HERE, 3, 80.0) == 3
    # in a power-on that has no row yet
    later = Encoder()
    later(HERE, 3, 80.0)
    later.instruments.remember_runs([1, 2], [10.0, 60.0])
    assert later.instruments.run == later(HERE, 3, 80.0) == 3


def test_without_a_word_of_the_encoder_it_gets_a_number_of_its_own():
    read = Encoder()
    read()
    read.instruments.remember_runs([1, 2], [np.nan, np.nan])
    assert read.instruments.run == read() == 3


def test_where_the_clock_began_anew_readings_of_before_are_forgotten():
    now = [100 * 10**9]
    read = Instruments(now=lambda: now[0])
    read.exposures.begin(Track(now[0], np.array([0.0, 600.0]), np.zeros((2, 2)), None))
    read.take_incremental(now[0], HERE, (0.0, 0.0))
    now[0] = 2 * 10**9
    with pytest.raises(ValueError, match='went back'):  # of the track that was commanded
        read.take_incremental(now[0], HERE, (0.0, 0.0))
    read.clock_back()
    assert (read.stamp, read.began) == (0, 1) and read.exposures.take(1.0, print) is None
    read.take_incremental(now[0], HERE, (0.0, 0.0))
    assert read.stamp == now[0]


class Wall:
    """Instruments on a clock of the test, of which the encoder speaks."""

    def __init__(self):
        self.now, self.stamp = 1000.0, 1_768_482_000 * 10**9
        self.instruments = Instruments(wall=lambda: self.now, live=True, absolute=False)

    def speaks(self, gaps, step=0.05):
        for gap in gaps:
            self.now += gap
            self.stamp += round(step * 1e9)
            self.instruments.count_message(MOUNT, self.stamp)

    def looks(self, seconds):
        """What is told at the last of looks half a second apart."""
        for _ in range(round(seconds / 0.5)):
            self.now += 0.5
            self.instruments.watch(10.0)
        return [text.partition('; look')[0]
                for text in self.instruments.health.sentences.values() if MOUNT in text]


@pytest.mark.parametrize('burst', [12, 30])
def test_messages_that_waited_for_the_start_are_no_rate(burst):
    """A 20 Hz encoder of which a busy process reads what has come, and again 0.6 s later."""
    wall = Wall()
    wall.instruments.watch(10.0)
    wall.speaks([0.0067] * burst)
    assert wall.instruments.usual(MOUNT) == pytest.approx(0.05)
    assert wall.looks(1.0) == []
    wall.speaks([0.001] * 12)
    assert wall.looks(1.0) == []
    wall.speaks([0.05] * 100)
    assert wall.looks(1.0) == [f'instrument {MOUNT}: silent; it sent something every 0.05 s']


def test_one_that_ends_while_it_starts_is_silent_too():
    wall = Wall()
    wall.speaks([0.05] * 15)
    assert wall.looks(1.5) == []
    assert wall.looks(0.5) == [f'instrument {MOUNT}: silent; it sent something every 0.05 s']


def test_a_clock_that_was_set_is_named_until_the_zero_is_new():
    wall, time = Wall(), [0.0]
    wall.instruments = Instruments(wall=lambda: wall.now, live=True, absolute=False,
                                   now=lambda: round((time[0] + wall.now) * 1e9))

    def reported():
        wall.looks(5.0)
        return [text for text in wall.instruments.health.sentences.values() if 'clock' in text]
    time[0] = 1_768_482_000.0
    assert reported() == []
    time[0] += 0.05  # what a busy process may lose between two calls
    assert reported() == []
    time[0] += 0.5
    (text,) = reported()
    assert text.startswith('instrument clock of this machine: set ahead by 0.50 s at 13:16:51 UTC')
    wall.instruments.health.clock()
    assert reported() == []
    time[0] -= 0.5
    assert 'set back by 0.50 s' in reported()[0]


def test_of_one_pause_nobody_is_slow():
    wall = Wall()
    wall.speaks([0.1, 25.0], step=25.0)
    assert wall.looks(0.5) == []
    wall.speaks([25.0, 25.0], step=25.0)
    assert ['a message every 25 s' in text for text in wall.looks(1.0)] == [True]
