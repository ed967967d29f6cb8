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

"""Orbits of the IGS and the ILRS: names, scales, faults of their own, and places by other code."""

from pathlib import Path

import numpy as np
import pytest

from msg_tools.units import ARCSEC, DEG
from pointing_model.sky.orbits.orbit_files import Orbits
from pointing_model.sky.refraction import Weather
from pointing_model.sky.satellite_place import Corrections, in_sunlight, satellite_place
from pointing_model.sky.site import Site

DATA = Path(__file__).resolve().parents[5] / 'shared' / 'data' / 'orbits'
GPS, LAGEOS = 'esa11802.eph', 'ilrsa.orb.lageos2.160319.v35.sp3.gz'
SITE = Site(34.3 * DEG, 109.0 * DEG, 500.0)


def orbits(name):
    if not (DATA / name).is_file():
        pytest.skip(f'{DATA / name} is absent')
    return Orbits([DATA / name])


def test_what_a_file_of_2002_calls_18_is_a_gps_satellite_in_gps_time():
    found = orbits(GPS)
    assert len(found.names) == 26 and found.names[0] == 'G01'
    orbit = found.orbit('PRN18')
    assert orbit.name == 'G18' and orbit.begin == 1029801587.0  # 13 s before midnight of UTC
    assert orbit.sigma(orbit.begin + 4e4) == pytest.approx(0.032, rel=0.01)


def test_two_orbits_of_2002_jump_and_no_other():
    found = orbits(GPS)
    for name in found.names:
        found.orbit(name)
    assert [note.split(' of ')[1].split()[0] for note in found.notes] == ['G25', 'G27']


def test_every_second_epoch_of_lageos_is_within_two_millimetres():
    arc = orbits(LAGEOS).orbit().arcs[0]
    off = arc.roughness()[0][10:-10]
    assert len(arc.epochs) == 5040 and np.sqrt(np.mean(off**2)) < 0.002


def test_place_of_lageos_agrees_with_skyfield():
    pytest.importorskip('skyfield', reason='the reference')
    import sys
    sys.path.insert(0, str(Path(__file__).resolve().parents[4] / 'benchmarks'))
    try:
        from orbits import _apart, _Peers
    finally:
        sys.path.pop(0)
    orbit = orbits(LAGEOS).orbit()
    time = np.floor(orbit.begin + np.linspace(7200.0, 60000.0, 30))
    peers, vacuum = _Peers(orbit, time), Weather(pressure_hpa=0.0)
    bare = Corrections(light_time=False, diurnal_aberration=False)
    el, az, _ = peers.geometric()
    assert _apart(*satellite_place(orbit, time, SITE, vacuum, corrections=bare)[:2],
                  az.radians, el.radians) < 1e-4
    el, az, _ = peers.apparent()
    assert _apart(*satellite_place(orbit, time, SITE, vacuum)[:2], az.radians, el.radians) < 1e-3
    peers.planets.close()


def test_passes_of_paper_000_on_a_precise_orbit():
    """PRN 18, its satellite, is below the horizon all that night; 28 passes overhead in the Sun."""
    found, night = orbits(GPS), 1029801600.0 + np.arange(12.4, 21.1, 0.05) * 3600.0
    assert satellite_place(found.orbit('18'), night, SITE)[1].max() < 0.0
    orbit = found.orbit('28')
    el = satellite_place(orbit, night, SITE)[1]
    up = el > 20.0 * DEG
    assert 88.0 < el.max() / DEG < 89.0 and in_sunlight(orbit, night[up]).all()
    assert 15.0 < (night[up][0] - 1029801600.0) / 3600.0 < 15.2


def test_eighteen_seconds_and_two_parts_of_a_time():
    orbit = orbits(GPS).orbit('28')
    time = orbit.begin + 4e4
    az, el, _ = satellite_place(orbit, time, SITE)
    wrong = satellite_place(orbit, time + 18.0, SITE)
    assert 300.0 < np.hypot((wrong[0] - az) * np.cos(el), wrong[1] - el) / ARCSEC < 900.0
    split = satellite_place(orbit, np.floor(time) - 5.0, SITE, rest=5.0 + time - np.floor(time))
    np.testing.assert_allclose(split[:2], (az, el), atol=1e-7 * ARCSEC)
