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

"""What is said of axes by their readings, where the guard may send them another way."""

import numpy as np

from msg_tools.units import ARCSEC, DEG
from pointing_model.mounts import ALTAZ
from telescope_mount.observing.axis_check import FollowingCheck
from telescope_mount.observing.axis_demand import Track

SECOND = 10**9
SPEED = 4.0 * DEG


def says(moves, sent, seconds=40.0, drift=0.1, scale=1.0, late=0.0, heard=0.0, **how):
    """All sentences about azimuths of a mount that is asked to go from 100 to -80 deg.

    Looks are half a second of the wall apart, of which the mount needs `late` to hear of it, and
    who looks hears `heard` after that where it was sent.
    """
    times = np.array([0.0, 60.0])
    demand = np.array([[-80.0, 40.0], [-80.0 + drift, 40.0]]) * DEG
    here = np.array([100.0, 40.0]) * DEG
    check = FollowingCheck(Track(0, times, demand, np.zeros((2, 2))), here, ALTAZ, 60.0 * ARCSEC,
                           **how)
    found = {}
    for i in range(round(seconds / 0.5 / scale)):
        t = 0.5 * i * scale
        gone = max(0.0, t - late * scale)
        place = np.array([moves(gone), 40.0 * DEG])
        told = 0.0 if t < (late + heard) * scale else gone
        wanted = None if sent is None else np.array([sent(told), 40.0 * DEG])
        text = check.fault(round(t * SECOND), place, 0.5 * i, wanted)
        if text:
            found.setdefault(text, t)
    return found


def to(end, begin=100.0):
    """An even motion."""
    way = (end - begin) * DEG
    return lambda t: begin * DEG + np.sign(way) * min(SPEED * t, abs(way))


def test_the_longer_way_because_of_cables_is_no_fault():
    assert says(to(280.0), to(280.0)) == {}
    # from 60 it is first farther away, which nobody who does not know the command understands
    assert says(to(280.0, 60.0), to(280.0, 60.0)) == {}
    assert any('moves away' in text for text in says(to(280.0, 60.0), None))


def test_an_axis_that_rests_where_it_is_sent_on_the_way_around_is_no_fault():
    def around(t):
        return to(20.0)(t) if t < 25.0 else to(-80.0, 20.0)(t - 25.0)
    assert says(around, around, 55.0) == {}


def test_an_axis_that_does_not_go_where_it_is_sent_is_named_in_time():
    (text, when), *_ = says(lambda t: 100.0 * DEG, to(280.0)).items()
    assert text == 'no axis has moved since the command' and when <= 1.5


def test_where_time_is_fast_the_way_of_messages_and_looks_is_no_fault():
    for scale in (5.0, 20.0, 50.0):
        for late in (0.0, 0.2, 0.7):
            assert says(to(280.0), to(280.0), scale=scale, late=late, seconds=55.0) == {}
            assert says(to(-70.0), None, scale=scale, late=late, seconds=42.0, drift=6.0) == {}
    (text, when), *_ = says(lambda t: 100.0 * DEG, to(280.0), scale=5.0).items()
    assert text == 'no axis has moved since the command' and when <= 5.0 * 2.0


def test_a_command_that_is_heard_of_later_than_the_axes_move_is_no_fault():
    for scale in (1.0, 5.0, 20.0):
        for heard in (0.2, 0.6):
            assert says(to(280.0, 60.0), to(280.0, 60.0), scale=scale, late=0.2, heard=heard,
                        seconds=55.0) == {}
    (text, when), *_ = says(to(120.0, 60.0), lambda t: 20.0 * DEG, scale=5.0).items()
    assert 'moves away' in text and when <= 5.0 * 1.5


def test_a_reading_that_is_looked_at_twice_is_one():
    check = FollowingCheck(Track(0, np.array([0.0, 60.0]), np.tile((-1.0, 0.7), (2, 1)),
                                 np.zeros((2, 2))), np.array([0.0, 0.7]), ALTAZ, 1e-4)
    assert check.fault(SECOND // 10, np.array([0.0, 0.7]), 0.1) == ''
    for wall in (0.6, 1.1, 1.2):
        assert check.fault(SECOND // 2, np.array([0.2, 0.7]), wall) == ''
    assert 'moves away' in check.fault(SECOND, np.array([0.3, 0.7]), 1.3)


def test_where_time_is_slow_an_axis_has_its_time_to_set_out():
    assert says(lambda t: to(280.0)(max(t - 1.0, 0.0)), None, scale=0.1, seconds=3.0) == {}


def test_an_axis_that_moves_at_a_first_look_that_comes_late_is_no_fault():
    check = FollowingCheck(Track(0, np.array([0.0, 60.0]), np.tile((-1.0, 0.7), (2, 1)),
                                 np.zeros((2, 2))), np.array([1.0, 0.7]), ALTAZ, 1e-4)
    assert check.fault(3 * SECOND, np.array([0.8, 0.7]), 3.0) == ''
    assert check.fault(4 * SECOND, np.array([0.8, 0.7]), 4.0) == ''
    assert 'stays' in check.fault(5 * SECOND, np.array([0.8, 0.7]), 5.0)


def test_an_axis_that_ends_beside_its_demand_is_named():
    found = says(to(279.0), to(280.0), 50.0, drift=0.0)
    assert any('stays' in text for text in found), found


def test_a_mount_that_slews_as_it_likes_may_rest_between_its_axes_and_take_the_other_way():
    def waits(t):  # for its other axis at first, and amid its way
        return to(20.0)(max(t - 4.0, 0.0)) if t < 27.0 else to(-80.0, 20.0)(max(t - 29.0, 0.0))
    assert any('no axis has moved' in text for text in says(waits, None, 60.0))
    assert says(waits, None, 59.0, drift=0.0, own_way=True) == {}
    assert says(to(280.0, 60.0), None, 55.0, drift=0.0, own_way=True) == {}


def test_a_mount_that_slews_as_it_likes_is_named_where_it_stands_or_ends_beside():
    (text, when), *_ = says(lambda t: 100.0 * DEG, None, own_way=True).items()
    assert text == 'no axis has moved since the command' and 5.0 < when <= 6.5
    found = says(to(279.0), None, 60.0, own_way=True)
    (text, when), *_ = found.items()
    assert text.startswith('azimuth stays') and 45.0 < when < 53.0


def test_a_driver_that_is_told_the_places_on_the_way_at_once_is_no_fault():
    def moves(t):
        return to(170.0, 60.0)(t) if t < 30.0 else to(280.0, 170.0)(t - 30.0)

    def told(t):
        return (170.0 if t < 30.0 else 280.0) * DEG
    assert says(moves, told, 60.0) == {}
    # but one that goes away from there is
    assert any('moves away' in text for text in says(to(120.0, 60.0), lambda t: 20.0 * DEG))
