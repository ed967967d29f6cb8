"""Which power-on a reading is of, by what the encoder tells and where it tells nothing."""

import numpy as np
import pytest

from msg_tools.power_on import PowerOn
from pointing_model.observing.instruments import Instruments

HERE, LOST = (1.0, 0.5), (np.nan, np.nan)


class Encoder:
    def __init__(self, first_run=1):
        self.instruments, self.stamp = Instruments(first_run), 0

    def __call__(self, angle=HERE, number=None, started=None):
        """Number of the run after a reading."""
        self.stamp += 10**9
        frame = '' if number is None else PowerOn(number, started).frame
        self.instruments.take_incremental(self.stamp, angle, (0.0, 0.0), frame)
        return self.instruments.run


def test_each_power_on_that_the_encoder_tells_is_a_run():
    read = Encoder(first_run=7)
    assert [read(LOST, 1, 10.0), read(HERE, 1, 10.0), read(HERE, 1, 10.0)] == [6, 7, 7]
    # a reading that is no number is no power-on, but a fault
    assert not read.instruments.health.alarms
    assert [read(LOST, 1, 10.0), read(HERE, 1, 10.0)] == [7, 7]
    assert 'no number, although it was homed' in read.instruments.health.alarms[0]
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


def test_the_power_on_of_the_absolute_encoder_is_no_run():
    read = Encoder()
    assert read(HERE, 1, 10.0) == 1 and read.instruments.absolute_power_on is None
    for number, started in ((1, 10.0), (2, 60.0)):
        read.instruments.take_absolute(int(started) * 10**9, HERE, PowerOn(number, started).frame)
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
    read.exposures.begin(now[0], np.array([0.0, 600.0]), np.zeros((2, 2)))
    read.take_incremental(now[0], HERE, (0.0, 0.0))
    now[0] = 2 * 10**9
    with pytest.raises(ValueError, match='run back'):  # of the track that was commanded
        read.take_incremental(now[0], HERE, (0.0, 0.0))
    read.clock_back()
    assert (read.stamp, read.began) == (0, 1) and read.exposures.take(1.0, print) is None
    read.take_incremental(now[0], HERE, (0.0, 0.0))
    assert read.stamp == now[0]
