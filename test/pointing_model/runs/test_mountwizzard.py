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

"""Model files of MountWizzard4: points of a German mount by its mechanical angles."""

import json

import numpy as np
import pytest

from calibration.analysis.term_fit import fit_terms
from msg_tools.units import ARCSEC, DEG
from pointing_model.model import PointingModel
from pointing_model.mounts import parse_mount
from pointing_model.runs.formats.csv import iso_utc
from pointing_model.sky.places import observed_to_icrs, sidereal_time
from pointing_model.sky.refraction import Weather
from pointing_model.sky.site import Site

SITE = Site(48.1 * DEG, 11.5 * DEG, 500.0)
AIR = Weather(955.0, 10.0)
MOUNT = parse_mount('german', SITE.latitude)
TERMS = dict(zip(MOUNT.names.physical, np.array([310, -170, 46, -23, 37, -21, 15]) * ARCSEC))


@pytest.fixture
def points():
    """40 points as the program writes them: hours and degrees, angles to 0.0001 deg."""
    rng = np.random.default_rng(2)
    time = 1_600_000_000.0 + 60.0 * np.arange(40)
    az, el = rng.uniform(0, 2 * np.pi, 40), rng.uniform(25, 75, 40) * DEG
    ra, dec = observed_to_icrs(az, el, time, SITE, AIR)
    west = np.arange(40) % 3 == 0
    first, second = PointingModel(TERMS, mount=MOUNT).sky_to_encoder(*MOUNT.axes_of(az, el, west))
    clock = sidereal_time(time, SITE)
    return [{
        'altitude': el[i] / DEG, 'azimuth': az[i] / DEG, 'imagePath': f'/m/image-{i:03d}.fits',
        'angularPosRA': round(first[i] / DEG % 360.0, 4),
        'angularPosDEC': round(second[i] / DEG - 90.0, 4), 'pierside': 'W' if west[i] else 'E',
        'raJ2000S': ra[i] / DEG / 15.0, 'decJ2000S': dec[i] / DEG, 'decJNowS': dec[i] / DEG + 0.1,
        'siderealTime': clock[i] / DEG / 15.0, 'latitude': 48.1, 'scaleS': 2.63,
        'julianDate': iso_utc(time[i:i + 1])[0][:19] + 'Z', 'mirroredS': False, 'success': True,
    } for i in range(40)]


def text(points):
    return json.dumps(points, sort_keys=True, indent=4)


@pytest.mark.parametrize('place', [{}, {'site': SITE}])
def test_points_of_both_sides_are_one_run(points, read, place):
    run = read(text(points), weather=AIR, **place)
    assert len(run) == 40 and run.mount.two_sided and not run.meta['excluded']
    # without the longitude the clock tells the day only: 0.1" of aberration
    fitted = fit_terms(run).model.terms
    for name, value in TERMS.items():
        assert fitted[name] == pytest.approx(value, abs=0.7 * ARCSEC), name


def test_declinations_in_radians_are_told(points, read):
    plain = read(text(points), weather=AIR)
    for point in points:
        point['decJ2000S'] *= DEG
    run = read(text(points), weather=AIR)
    assert run['el'] == pytest.approx(plain['el'], abs=1e-12)


def test_points_that_are_no_rows_are_named(points, read):
    points[3].update(success=False, message='Solve failed')
    del points[5]['angularPosRA']
    points[8]['raJ2000S'] = float('nan')
    points[9]['decJ2000S'] += 20.0
    points[12]['scaleS'] = 5.1
    points[14]['mirroredS'] = True
    told = {row['row']: row['reason'] for row in read(text(points)).meta['excluded']}
    assert sorted(told) == [4, 6, 9, 10, 13, 15]
    assert told[4] == 'not solved (Solve failed)' and told[6] == 'no angularPosRA'
    assert told[9] == 'no raJ2000S' and 'does not belong to decJNowS' in told[10]
    assert 'a false solve' in told[13] and 'mirrored' in told[15]


def test_a_point_solved_twice_is_named(points, read):
    points.append({**points[7], 'raJ2000S': points[7]['raJ2000S'] + 1e-5})
    assert read(text(points)).meta['excluded'] == [
        {'row': 41, 'reason': 'a second solution of the image of row 8'}]


@pytest.mark.parametrize('change, words', [
    (lambda p: [q.update(julianDate='yesterday') for q in p[2:]], ['julianDate', "'yesterday'"]),
    (lambda p: p[2].update(latitude=-20.0), ['several sites']),
    (lambda p: [point.pop('latitude') for point in p], ['no point has the latitude']),
    (lambda p: [point.update(success=False) for point in p], ['none of 40 rows', 'not solved']),
])
def test_files_that_cannot_be_used_are_one_line(points, refuse, change, words):
    change(points)
    refuse(text(points), *words)


def test_spoiled_files_are_one_line(points, read):
    whole = text(points[:6])
    rng = np.random.default_rng(5)
    for _ in range(100):
        i, j = np.sort(rng.integers(0, len(whole), 2))
        for spoiled in (whole[:i] + whole[min(j, i + 9):], whole[:i]):
            try:
                run = read(spoiled)
            except ValueError as error:
                assert 'run.txt' in str(error) and '\n' not in str(error)
                continue
            assert np.isfinite(run['az']).all()
