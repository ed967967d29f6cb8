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

import dataclasses

import numpy as np
import pytest

from encoder_sim.mount_geometry import MountErrors, MountGeometry, direction
from encoder_sim.scenario import Scenario, TrueWeather
from encoder_sim.scenario_file import load_scenario
from encoder_sim.star_camera import Camera
from encoder_sim.star_camera import CameraErrors as Params
from msg_tools.units import ARCSEC, DEG
from pointing_model.sky.places import observed_place
from pointing_model.sky.refraction import DEFAULT_WEATHER, Weather
from pointing_model.sky.site import DEFAULT_SITE
from pointing_model.sky.star_catalogue import load_catalogue, satellite_target

NIGHT = 1_768_482_000  # 2026-01-15 13:00 UTC
STAMP = NIGHT * 10**9
GEOMETRY = MountGeometry(MountErrors())


@pytest.fixture(scope='module')
def stars():
    """Stars of the sky at the start of the night, brightest within a degree: (stars, az, el)."""
    stars = load_catalogue(3.0)
    az, el = observed_place(stars, NIGHT)
    up = (el > 15 * DEG) & (el < 80 * DEG)
    stars, az, el = stars.select(up), az[up], el[up]
    near = direction(az, el) @ direction(az, el).T > np.cos(1 * DEG)
    brightest = np.all(~near | (stars.mag[:, None] <= stars.mag[None, :]), axis=1)
    return stars.select(brightest), az[brightest], el[brightest]


def test_centred_star(stars):
    stars, az, el = stars
    seen = Camera(Scenario(), 1).expose(np.full(len(az), STAMP), GEOMETRY.frames(az, el))
    assert np.array_equal(seen.hip, stars.hip)
    assert np.array_equal(seen.mag, stars.mag)
    assert np.abs(seen.miss).max() < 1e-4 * ARCSEC


def test_sign_is_star_minus_boresight(stars):
    _, az, el = stars
    frames = GEOMETRY.frames(az - 20 * ARCSEC / np.cos(el), el + 7 * ARCSEC)
    miss = Camera(Scenario(), 1).expose(np.full(len(az), STAMP), frames).miss / ARCSEC
    assert miss == pytest.approx(np.tile([20.0, -7.0], (len(az), 1)), abs=0.02)


def test_tracking_through_hours(stars):
    """The coarse search must follow the sky for nights and years."""
    stars, _, _ = stars
    camera = Camera(Scenario(), 1)
    camera.expose(STAMP, GEOMETRY.frames(0.0, 0.5))
    for later in (1.0, 5 * 3600.0, 40 * 86400.0, 5 * 3.15e7):
        time = NIGHT + later
        az, el = observed_place(stars, time)
        up = (el > 15 * DEG) & (el < 80 * DEG)
        seen = camera.expose(np.full(up.sum(), int(time) * 10**9), GEOMETRY.frames(az[up], el[up]))
        assert np.mean(seen.hip == stars.hip[up]) > 0.99


def test_no_star_no_number():
    camera = Camera(Scenario(camera=Params(field_of_view=1 * 60 * ARCSEC, mag_limit=2.0)), 1)
    seen = camera.expose([STAMP, STAMP], GEOMETRY.frames([0.0, 1.0], [0.9, 1.0]))
    assert np.isnan(seen.miss).all() and np.all(seen.hip == 0) and np.isnan(seen.mag).all()
    # underground, where there are stars too
    stars = load_catalogue(2.0)
    az, el = observed_place(stars, NIGHT, DEFAULT_SITE, Weather(pressure_hpa=0.0))
    down = el < -0.2
    seen = camera.expose(np.full(down.sum(), STAMP), GEOMETRY.frames(az[down], el[down]))
    assert np.all(seen.hip == 0)
    assert camera.expose([], np.empty((0, 3, 3))).miss.shape == (0, 2)


def test_edge_of_the_field(stars):
    _, az, el = stars
    camera = Camera(Scenario(camera=Params(field_of_view=10 * 60 * ARCSEC)), 1)
    for offset, found in ((4.9, True), (5.1, False)):
        frames = GEOMETRY.frames(az, el + offset * 60 * ARCSEC)
        seen = camera.expose(np.full(len(az), STAMP), frames)
        assert np.isfinite(seen.miss[seen.mag < 3.0]).all()
        assert np.mean(seen.mag <= 3.0) == (1.0 if found else 0.0)


def test_the_brightest_star_wins():
    """Mizar outshines Alcor, 12' beside it, even where Alcor is centred."""
    pair = load_catalogue(hip=[65378, 65477])
    time = NIGHT + 9 * 3600
    az, el = observed_place(pair, time)
    assert el.min() > 15 * DEG
    camera = Camera(Scenario(), 1)
    seen = camera.expose(time * 10**9, GEOMETRY.frames(az[1], el[1]))
    assert seen.hip[0] == 65378
    assert np.hypot(*seen.miss[0]) / ARCSEC == pytest.approx(708, abs=5)
    faint = Camera(Scenario(camera=Params(field_of_view=10 * 60 * ARCSEC)), 1)
    assert faint.expose(time * 10**9, GEOMETRY.frames(az[1], el[1])).hip[0] == 65477


def test_rotation_scale_and_noise(stars):
    _, az, el = stars
    frames = GEOMETRY.frames(az - 100 * ARCSEC / np.cos(el), el)
    n = np.full(len(az), STAMP)
    plain = Camera(Scenario(), 1).expose(n, frames).miss
    turned = Camera(Scenario(camera=Params(rotation=0.01)), 1).expose(n, frames).miss
    # from +x towards +y
    expected = np.sin(0.01) * plain[:, 0] + np.cos(0.01) * plain[:, 1]
    assert turned[:, 1] == pytest.approx(expected)
    assert np.all(turned[:, 1] > 0.9 * ARCSEC)
    larger = Camera(Scenario(camera=Params(scale_error=0.02)), 1).expose(n, frames).miss
    assert larger == pytest.approx(1.02 * plain)

    noisy = Camera(Scenario(camera=Params(star_noise=1 * ARCSEC)), 1)
    stamps = STAMP + 1000 * np.arange(1500)
    frames = np.repeat(GEOMETRY.frames(az[:1], el[:1]), 1500, axis=0)
    miss = noisy.expose(stamps, frames).miss
    error = (miss - Camera(Scenario(), 1).expose(stamps, frames).miss) / ARCSEC
    assert error.std(axis=0) == pytest.approx([1.0, 1.0], abs=0.06)
    assert abs(np.corrcoef(error.T)[0, 1]) < 0.08
    # the noise is of the star's exposures, one after the other, whatever their time
    later = Camera(Scenario(camera=Params(star_noise=1 * ARCSEC)), 1)
    for i in range(20):
        alone = later.expose(stamps[i] + 700_000, frames[0])
        plain = Camera(Scenario(), 1).expose(stamps[i] + 700_000, frames[0])
        assert (alone.miss - plain.miss)[0] / ARCSEC == pytest.approx(error[i], abs=1e-9)
    assert later.exposed == {int(alone.hip[0]): 20}


def test_each_star_night_and_seed_has_its_own_noise(stars):
    _, az, el = stars
    frames = GEOMETRY.frames(az, el)

    def noise(seed, start):
        params = Params(star_noise=1 * ARCSEC)
        return [Camera(Scenario(camera=one), seed, start=start).expose(
            np.full(len(az), STAMP), frames).miss for one in (params, Params())]

    found = [(noisy - plain) / ARCSEC for noisy, plain in (noise(1, 0.0), noise(2, 0.0),
                                                           noise(1, 86400.0))]
    assert all(abs(np.corrcoef(found[0].ravel(), other.ravel())[0, 1]) < 0.2
               for other in found[1:])
    assert len(np.unique(found[0])) == 2 * len(az)


def test_clock_and_weather_of_the_truth(stars):
    stars, az, el = stars
    frames = GEOMETRY.frames(az, el)
    n = np.full(len(az), STAMP)
    late = Camera(Scenario(clock_offset=1.0), 1).expose(n, frames).miss / ARCSEC
    # the stars have gone on for a second, to where the clock has not got yet
    later_az, later_el = observed_place(stars, NIGHT + 1.0)
    moved = np.stack([(later_az - az) * np.cos(el), later_el - el], axis=1) / ARCSEC
    assert np.hypot(*moved.T).max() == pytest.approx(15.0, abs=1.0)
    assert late == pytest.approx(moved, abs=0.01)
    thin = dataclasses.replace(DEFAULT_WEATHER, pressure_hpa=900.0)
    lower = Camera(Scenario(), 1, weather=thin).expose(n, frames).miss / ARCSEC
    # 55 hPa less raise the star by 3.2" less at 45 degrees
    assert lower[:, 1] == pytest.approx(-3.2 / np.tan(el), rel=0.05)
    assert lower[:, 0] == pytest.approx(np.zeros(len(az)), abs=0.01)


def test_from_scenario(tmp_path, stars):
    _, az, el = stars
    path = tmp_path / 'mine.yaml'
    path.write_text(
        'clock_offset_ms: 250\nweather: {pressure_hpa: 900, temperature_c_per_hour: -2}\n'
        'site: {latitude_deg: 34.31}\ncamera: {rotation_deg: 1}\n'
    )
    camera = Camera(load_scenario(path), 1, start=float(NIGHT))
    assert camera.clock_offset == 0.25 and camera.weather.pressure_hpa == 900
    assert camera.site.latitude == pytest.approx(34.31 * DEG)
    plain = Camera(load_scenario('ideal'), 1)
    assert plain.site == DEFAULT_SITE and plain.weather == DEFAULT_WEATHER

    # air that cools by 2 degC bends more
    cooling = Camera(
        Scenario(weather=TrueWeather(temperature_rate=-2.0)), 1, start=NIGHT - 1.0)
    higher = cooling.expose(np.full(len(az), STAMP), GEOMETRY.frames(az, el)).miss[:, 1]
    assert higher / ARCSEC == pytest.approx(57.0 * 955 / 1013 * 2 / 283 / np.tan(el), rel=0.1)


def test_a_satellite_is_seen_where_it_is():
    satellite = satellite_target('gps-26690')
    night = 1_379_854_800  # 2013-09-22 13:00 UTC
    az, el = satellite.place(np.array([float(night)]), DEFAULT_SITE, DEFAULT_WEATHER)
    camera = Camera(Scenario(), 1, satellite=satellite)
    stamps = np.array([night * 10**9] * 2)
    frames = GEOMETRY.frames(np.append(az - 20 * ARCSEC / np.cos(el), az + 3.0), np.repeat(el, 2))
    miss = camera.expose_satellite(stamps, frames)
    assert miss[0] / ARCSEC == pytest.approx([20.0, 0.0], abs=0.02)
    assert np.isnan(miss[1]).all()
    assert np.isnan(Camera(Scenario(), 1).expose_satellite(stamps, frames)).all()
