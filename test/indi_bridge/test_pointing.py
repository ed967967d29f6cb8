"""From axes to places of date and back, and a driver that goes elsewhere brought to its axes."""

import numpy as np
import pytest

from indi_bridge.pointing import AxisFollower, axes_at, place_of_date
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.geometry import sky_to_encoder
from pointing_model.mounts import ALTAZ, Mount, is_beyond, through_pole
from pointing_model.sky import Site

SITE = Site()
GERMAN = Mount.equatorial(SITE.latitude, 'german')
TIME = 1_768_482_000.0


@pytest.mark.parametrize('beyond', [False, True])
def test_axes_become_a_place_of_date_and_the_same_axes_again(beyond):
    axes = GERMAN.on_travel(*through_pole(np.array(-20.0 * DEG if beyond else 20.0 * DEG),
                                          np.array(40.0 * DEG), beyond))
    ra, dec = place_of_date(GERMAN, axes, TIME, SITE)
    assert dec == pytest.approx(40.0 * DEG)
    assert axes_at(GERMAN, ra, dec, TIME, SITE, beyond) == pytest.approx(axes)


def test_an_altazimuth_mount_is_refused_in_one_line():
    with pytest.raises(ValueError, match='a mount that is altaz cannot be told its axes'):
        place_of_date(ALTAZ, (1.0, 0.5), TIME, SITE)


@pytest.mark.parametrize('beyond', [False, True])
def test_a_driver_with_a_model_of_its_own_is_brought_to_the_demanded_axes(beyond):
    terms = dict.fromkeys(('IH', 'ID', 'CH', 'NP', 'MA', 'ME'), 300.0 * ARCSEC)
    demand = np.array(GERMAN.on_travel(*through_pole(
        np.array(-35.0 * DEG if beyond else 35.0 * DEG), np.array(50.0 * DEG), beyond)))
    follower, steps = AxisFollower(GERMAN, SITE), 0
    while True:
        ra, dec = follower.target(demand, TIME)
        perfect = axes_at(GERMAN, ra, dec, TIME, SITE, beyond)
        reading = np.array(sky_to_encoder(*perfect, terms, GERMAN))
        steps += 1
        if not follower.learn(demand, reading):
            break
    assert follower.arrived(demand, reading) and 2 <= steps <= 4


def test_axes_on_the_other_side_of_the_pier_are_not_chased():
    follower = AxisFollower(GERMAN, SITE)
    demand = np.array([100.0, 30.0]) * DEG
    other = np.array([280.0, 150.0]) * DEG
    assert follower.other_side(demand, other) and not follower.learn(demand, other)
    assert is_beyond(other[1]) and np.all(follower.correction == 0.0)
    assert np.abs(wrap(follower.off(demand, demand))).max() == 0.0
