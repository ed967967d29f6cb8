"""What is said of axes by their readings, where the guard may send them another way."""

import numpy as np

from msg_tools.units import ARCSEC, DEG
from pointing_model.mounts import ALTAZ
from pointing_model.observing.following_check import FollowingCheck
from pointing_model.observing.pointing import Track

SECOND = 10**9
SPEED = 4.0 * DEG


def says(moves, sent, seconds=40.0, drift=0.1, **how):
    """All sentences about azimuths of a mount that is asked to go from 100 to -80 deg."""
    times = np.array([0.0, 60.0])
    demand = np.array([[-80.0, 40.0], [-80.0 + drift, 40.0]]) * DEG
    here = np.array([100.0, 40.0]) * DEG
    check = FollowingCheck(Track(0, times, demand, np.zeros((2, 2))), here, ALTAZ, 60.0 * ARCSEC,
                           **how)
    found = {}
    for i in range(round(seconds / 0.5)):
        t = 0.5 * i
        place = np.array([moves(t), 40.0 * DEG])
        wanted = None if sent is None else np.array([sent(t), 40.0 * DEG])
        text = check.say(round(t * SECOND), place, wanted)
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
