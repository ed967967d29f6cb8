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

"""Passes of a satellite over a site."""


import numpy as np
import pytest

from msg_tools.units import ARCSEC, DEG
from pointing_model.sky.elements import GPS_26690, parse_elements
from pointing_model.sky.places import sun_place
from pointing_model.sky.satellite_passes import passes
from pointing_model.sky.satellite_place import in_sunlight, satellite_place

GPS = parse_elements(GPS_26690)
START = 1379721600.0  # 2013-09-21
ISS = ('1 25544U 98067A   13264.51000000  .00002182  00000-0  45000-4 0  9991',
       '2 25544  51.6480 100.0000 0003000  80.0000 280.0000 15.50000000849993')


def _with_checksum(line):
    from sgp4.io import compute_checksum
    return line[:68] + str(compute_checksum(line[:68] + '0'))


def test_passes_are_above_the_limit_and_complete():
    found = passes(GPS, START, 72.0)
    assert len(found) == 3
    for one in found:
        edges = satellite_place(GPS, np.array([one.start, one.end]))[1]
        assert np.max(np.abs(edges - 20.0 * DEG)) < 0.1 * ARCSEC
        grid = np.arange(one.start, one.end, 30.0)
        el = satellite_place(GPS, grid)[1]
        assert np.all(el > 20.0 * DEG - ARCSEC)
        assert one.top_el >= el.max() and abs(grid[el.argmax()] - one.top) < 30.0
    # a GPS orbit repeats over a site every sidereal day
    assert np.diff([p.top for p in found]) == pytest.approx(86164.0, abs=120.0)


def test_passes_cut_by_the_window_keep_its_ends():
    whole = passes(GPS, START, 24.0)[0]
    cut = passes(GPS, whole.start + 3600.0, 2.0)
    assert len(cut) == 1
    assert (cut[0].start, cut[0].end) == (whole.start + 3600.0, whole.start + 3 * 3600.0)
    assert passes(GPS, whole.end + 60.0, 1.0) == []
    with pytest.raises(ValueError, match='must be > 0'):
        passes(GPS, START, 0.0)


def test_low_orbit_is_seen_only_in_the_dark_and_in_sunlight():
    iss = parse_elements([_with_checksum(line) for line in ISS])
    start = START + 10.0 * 86400.0
    every = passes(iss, start, 72.0, min_el=10.0 * DEG, step=20.0)
    dark = passes(iss, start, 72.0, min_el=10.0 * DEG, dark=True, step=20.0)
    assert 0 < len(dark) < len(every)
    for one in dark:
        inside = np.linspace(one.start + 0.1, one.end - 0.1, 9)
        assert np.all(sun_place(inside)[1] < -12.0 * DEG) and np.all(in_sunlight(iss, inside))


def test_a_pass_shorter_than_the_step_is_found():
    iss = parse_elements([_with_checksum(line) for line in ISS])
    found = passes(iss, START, 240.0, min_el=10.0 * DEG)
    for high in found[:20]:
        low = high.top_el - 0.005 * DEG
        short = [one for one in passes(iss, high.start, 0.5, min_el=low) if one.top < high.end]
        assert len(short) == 1 and 0.0 < short[0].end - short[0].start < 20.0
        assert short[0].start - 0.01 < high.top < short[0].end + 0.01
    # as the hours begin, and as they end
    assert len(passes(iss, high.top - 1.0, 0.01, min_el=low)) == 1
    assert len(passes(iss, high.top - 35.0, 0.01, min_el=low)) == 1
