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

"""Drives, bearings, wind and air: each does what its sources say, whatever the batches."""

import dataclasses

import numpy as np
import pytest

from encoder_sim.azimuth_track import Runout
from encoder_sim.drives import Drives, ShaftCouplings
from encoder_sim.mount import RESTLESS_RATE, SimulatedMount
from encoder_sim.mount_geometry import (
    FORWARD,
    MountErrors,
    MountGeometry,
    azimuth_elevation,
    bent,
    direction,
)
from encoder_sim.scenario import Scenario
from encoder_sim.scenario_file import load_scenario, scenario_names
from encoder_sim.seeing import (
    AirLayers,
    Seeing,
    SlowNoise,
    TurbulentRefraction,
    airmass,
    ar_noise,
    motion_sigma,
    photon_sigma,
    seeing_sigma,
)
from encoder_sim.star_camera import Camera
from encoder_sim.wind_gusts import Wind, WindLoad, von_karman
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.sky.places import observed_place
from pointing_model.sky.star_catalogue import load_catalogue

NIGHT = 1_768_482_000
SIDEREAL = 15.04 * ARCSEC
MINE = ('coupling', 'gusts', 'runout', 'seeing', 'servo_lag', 'stick_slip', 'wandering_refraction')


def test_each_scenario_differs_from_the_default_and_the_default_has_none():
    default = load_scenario('default')
    assert {f'mount_{name}' for name in MINE} <= set(scenario_names())
    for name in MINE:
        scenario = load_scenario(f'mount_{name}')
        assert dataclasses.replace(scenario, name='default') != default, name
    for part in ('drives', 'coupling', 'wind', 'seeing', 'layers'):
        assert getattr(default, part) == getattr(Scenario(), part), part
    assert default.mount.runouts == ()


@pytest.mark.parametrize('text, where', [
    ('drives: {azimuth: {gain_per_s: -1}}', 'drives.azimuth.gain_per_s'),
    ('drives: {azimuth: {feed_forward_percent: 101}}', '0 to 100'),
    ('coupling: {elevation: {distance_deg: 0}}', 'distance_deg'),
    ('wind: {speed_m_s: 61}', 'wind.speed_m_s'),
    ('seeing: {aperture_m: 0}', 'seeing.aperture_m'),
    ('layers: {correlation_time_min: 0}', 'layers.correlation_time_min'),
    ('mount: {runouts: [{per_turn: 0}]}', 'runouts[0].per_turn'),
])
def test_out_of_range_is_refused(tmp_path, text, where):
    (tmp_path / 'bad.yaml').write_text(text + '\n')
    with pytest.raises(ValueError) as caught:
        load_scenario(tmp_path / 'bad.yaml')
    assert where in str(caught.value)


# --- noise in time --------------------------------------------------------------------------------


def test_the_same_moment_has_the_same_noise_in_any_batch():
    noise = ar_noise(600.0, 3, 'a', 'b')
    times = np.linspace(0.0, 9000.0, 5001)
    whole = noise.at(times)
    np.testing.assert_allclose([noise.at(t) for t in times[::500]], whole[::500], atol=1e-12)
    np.testing.assert_allclose(noise.at(times[::-1])[::-1], whole, atol=1e-12)
    assert np.abs(ar_noise(600.0, 4, 'a', 'b').at(times) - whole).max() > 0.5
    assert noise.at(np.empty(0)).shape == (0,) and noise.at(np.zeros((2, 3))).shape == (2, 3)


def test_an_ar_process_forgets_exponentially():
    times, lag = np.arange(0.0, 300 * 600.0, 60.0), 10
    pairs = [ar_noise(600.0, seed, 'a', 'b').at(times) for seed in range(12)]
    assert np.mean([np.mean(x * x) for x in pairs]) == pytest.approx(1.0, abs=0.1)
    assert np.mean([np.mean(x[:-lag] * x[lag:]) for x in pairs]) == pytest.approx(
        np.exp(-1.0), abs=0.1)


def test_the_mean_over_an_exposure_is_exact():
    noise = SlowNoise(lambda f: f**-1.0, 0.01, 5.0, 1, 'a', 'b')
    inside = noise.at(7.0 + np.linspace(-1.0, 1.0, 4001))
    assert noise.at(7.0, exposure=2.0) == pytest.approx(np.trapezoid(inside) / 4000, abs=1e-5)


# --- drives ---------------------------------------------------------------------------------------


def lagging(name='mount_servo_lag'):
    return SimulatedMount(load_scenario(name), seed=1), SimulatedMount(load_scenario('default'))


def behind(rate, name='mount_servo_lag', start=(200.0, 50.0), after=20.0, span=1.0, n=11):
    """Demand - axis (n, 2), rad, of a track at `rate`, from `after` seconds past its settling."""
    times = np.array([0.0, 600.0])
    places = np.array(start) * DEG + times[:, np.newaxis] * rate
    out = []
    for device in lagging(name):
        settled = device.follow(0.0, times, places, [rate] * 2)
        out.append(device.truth(settled + after + np.linspace(0.0, span, n))[0])
    return out[1] - out[0]


def test_a_type_1_servo_is_behind_by_rate_over_gain():
    rate = np.array([SIDEREAL, -0.5 * SIDEREAL])
    np.testing.assert_allclose(behind(rate), np.tile(rate / 4.0, (11, 1)), rtol=1e-6)


def test_feed_forward_takes_its_part_and_acceleration_counts():
    pair = load_scenario('mount_servo_lag').drives
    pair = dataclasses.replace(
        pair, azimuth=dataclasses.replace(pair.azimuth, feed_forward=0.9))

    def state(times):  # rate and acceleration
        return None, np.stack([1.0 + 0.1 * times, 1.0 + 0.1 * times], axis=1)
    # r' / gain - r'' / gain^2
    wanted = (1.0 + 0.1 * 5.0) / 4.0 - 0.1 / 16.0
    np.testing.assert_allclose(
        Drives(pair, 1).lag(np.array([5.0]), state), [[0.1 * wanted, wanted]], rtol=1e-9)


def test_what_a_slew_leaves_dies_out_with_the_loop():
    late, later = (behind(np.zeros(2), after=after, n=1)[0, 0] for after in (0.25, 1.25))
    assert late > 1.0 * ARCSEC
    assert later / late == pytest.approx(np.exp(-4.0), rel=0.05)


def test_an_axis_that_sticks_stands_and_slips_at_low_rates_only():
    slow = np.array([5.0, -5.0]) * ARCSEC
    lag = behind(slow, 'mount_stick_slip', span=10.0, n=2001) / ARCSEC
    size = 10.0 * np.exp(-((5.0 / 20.0) ** 2))
    assert lag[:, 0].min() >= 0.0 and lag[:, 1].max() <= 0.0  # behind, on either way
    assert np.ptp(lag, axis=0) == pytest.approx([size, size], rel=0.02)
    jumps = np.abs(np.diff(lag, axis=0)) > 0.5 * size
    np.testing.assert_array_equal(jumps.sum(0), [5, 5])  # 50" in slips of 10"
    fast = behind(np.array([60.0, -60.0]) * ARCSEC, 'mount_stick_slip')
    assert np.abs(fast).max() < 0.01 * ARCSEC
    again = behind(slow, 'mount_stick_slip', span=10.0, n=2001) / ARCSEC
    np.testing.assert_array_equal(lag, again)


def test_the_servo_does_not_mistake_its_lag_for_an_error_of_the_encoder():
    device, _ = lagging()
    rate = np.array([[SIDEREAL, SIDEREAL]] * 2)
    settled = device.follow(0.0, [0.0, 600.0], [[3.0, 0.8], [3.0 + 600 * SIDEREAL,
                                                           0.8 + 600 * SIDEREAL]], rate)
    truth = device.truth(np.array([settled]))[0][0]
    device.feedback(round(settled * 1e9), truth + 5.0 * ARCSEC, smooth=False)
    np.testing.assert_allclose(device.servo, 5.0 * ARCSEC, rtol=1e-9)


def test_restless_axes_are_sampled_more_often():
    assert lagging('mount_stick_slip')[0].sample_rate == RESTLESS_RATE
    assert lagging('mount_gusts')[0].sample_rate == RESTLESS_RATE
    assert lagging()[0].sample_rate == lagging()[1].sample_rate == 0.0


def test_a_coupling_winds_up_against_the_motion_along_the_way():
    couplings = ShaftCouplings(load_scenario('mount_coupling').coupling)

    def twist(az, el=0.7):
        return (np.array([az, el]) - couplings.turn([az, el])) / ARCSEC
    assert twist(1.0) == pytest.approx([0.0, 0.0])
    assert twist(1.5) == pytest.approx([6.0, 0.0], abs=1e-6)
    back = twist(1.5 - 0.5 * DEG)  # after a reversal 1/e of the change is left
    assert back == pytest.approx([6.0 * (2.0 * np.exp(-1.0) - 1.0), 0.0])
    assert twist(1.5 - 0.5 * DEG) == pytest.approx(back)  # standing, it stays
    # what it does depends on the way, not on how often it is looked at
    for part in np.linspace(0.5, 3.0, 40):
        last = twist(1.5 - part * DEG)
    other = ShaftCouplings(load_scenario('mount_coupling').coupling)
    for az in (1.0, 1.5, 1.5 - 3.0 * DEG):
        one = other.turn([az, 0.7])
    assert last[0] == pytest.approx((1.5 - 3.0 * DEG - one[0]) / ARCSEC)


# --- bearing --------------------------------------------------------------------------------------


def test_run_out_does_not_repeat_after_a_turn_and_slips():
    part = Runout(per_turn=0.43, amplitude=4.0 * ARCSEC)
    az = np.linspace(0.0, 2.0 * np.pi, 50)
    geometry = MountGeometry(MountErrors(runouts=(part,)), NIGHT)

    def dip(turns, time=None, geometry=geometry):
        el = azimuth_elevation(geometry.boresight(az + 2.0 * np.pi * turns, 0.7, time=time))[1]
        return (0.7 - el) / ARCSEC
    for turns in (0, 1, -3):
        assert dip(turns) == pytest.approx(
            4.0 * np.cos(0.43 * (az + 2.0 * np.pi * turns)), abs=1e-3)
    slipping = MountGeometry(MountErrors(runouts=(dataclasses.replace(part, slip=1.0),)), NIGHT,
                             seed=2)
    assert np.abs(dip(0, NIGHT + 60.0, slipping) - dip(0, NIGHT, slipping)).max() < 1.0
    after = [dip(0, NIGHT + hours * 3600.0, slipping) for hours in range(6)]
    assert np.ptp(after, axis=0).max() > 3.0
    assert dip(0, None, slipping) == pytest.approx(dip(0))


# --- wind -----------------------------------------------------------------------------------------


def test_the_wind_pushes_with_the_square_of_its_speed_across_the_tube():
    still = Wind(speed=10.0, origin=0.0, intensity=0.0, shelter=0.0, bending=3.0 * ARCSEC)
    az, el = np.array([0.0, 90.0, 90.0, 180.0]) * DEG, np.array([40.0, 0.0, 60.0, 40.0]) * DEG
    frames = MountGeometry(MountErrors()).frames(az, el)

    def moved(wind):
        load = WindLoad(wind, 1)
        new = azimuth_elevation(bent(frames, load.bend(np.zeros(4), frames[:, FORWARD]))[:, 1])
        return np.array([wrap(new[0] - az) * np.cos(el), new[1] - el]) / ARCSEC
    # from the north, to the south: up where it looks north, to larger azimuth in the east
    sine = 3.0 * np.sin(40.0 * DEG)
    wanted = np.array([[0.0, 3.0, 3.0, 0.0], [sine, 0.0, 0.0, -sine]])
    assert moved(still) == pytest.approx(wanted, abs=1e-3)
    assert moved(dataclasses.replace(still, speed=20.0)) == pytest.approx(4.0 * wanted, abs=1e-2)
    sheltered = moved(dataclasses.replace(still, shelter=0.5))
    assert sheltered[1, [0, 3]] == pytest.approx([sine, -0.5 * sine], abs=1e-3)


def test_gusts_have_their_strength_and_the_servo_takes_up_the_slow_ones():
    wind = Wind(speed=10.0, origin=0.0, intensity=0.2, length=50.0, size=0.01, shelter=0.0,
                bending=1.0 * ARCSEC, shake=1.0 * ARCSEC, bandwidth=1e-3)
    times = np.arange(0.0, 4000.0, 0.5)
    angles = np.tile([90.0 * DEG, 0.0], (len(times), 1))

    def shaken(wind):
        return np.std(WindLoad(wind, 5).turn(times, angles)[:, 0]) / ARCSEC
    assert shaken(wind) == pytest.approx(2.0 * 0.2, rel=0.1)
    slow, fast = (shaken(dataclasses.replace(wind, bandwidth=b)) for b in (0.2, 5.0))
    assert fast < 0.4 * slow < 0.8 * shaken(wind)
    load = WindLoad(wind, 5)
    ahead = np.tile(direction(90.0 * DEG, 0.0), (len(times), 1))
    short, long = (np.std(np.linalg.norm(load.bend(times, ahead, e), axis=1)) for e in (0.0, 30.0))
    assert long < 0.7 * short
    # both come of one gust
    gust = np.linalg.norm(load.bend(times, ahead), axis=1)
    assert np.corrcoef(gust, load.turn(times, angles)[:, 0])[0, 1] > 0.9


def test_von_karmans_spectrum_has_its_integral_and_slope():
    f = np.geomspace(1e-6, 1e4, 20001)
    power = von_karman(f, 12.0, 80.0)
    assert np.trapezoid(power, f) == pytest.approx(1.0, abs=0.01)
    assert np.log10(von_karman(100.0, 12.0, 80.0) / von_karman(10.0, 12.0, 80.0)) == pytest.approx(
        -5.0 / 3.0, abs=1e-3)


# --- air ------------------------------------------------------------------------------------------

SEEING = Seeing(fwhm=2.0 * ARCSEC, aperture=0.2, motion_time=1.0, star_rate=1e7)
UP, LOW = 90.0 * DEG, 30.0 * DEG


def test_image_motion_goes_with_airmass_aperture_and_exposure():
    assert airmass(np.array([UP, LOW])) == pytest.approx([1.0, 1.995], abs=0.002)
    at = motion_sigma(SEEING, UP, 1e-9, 0.5e-6)
    r0 = 0.98 * 0.5e-6 / (2.0 * ARCSEC)
    assert at == pytest.approx(np.sqrt(0.182 * (0.2 / r0) ** (5 / 3)) * 0.5e-6 / 0.2, rel=1e-3)
    assert motion_sigma(SEEING, LOW, 1e-9, 0.5e-6) / at == pytest.approx(2.0**0.5, rel=0.01)
    large = dataclasses.replace(SEEING, aperture=12.8)
    assert motion_sigma(large, UP, 1e-9, 0.5e-6) / at == pytest.approx(64.0 ** (-1 / 6))
    assert motion_sigma(SEEING, UP, 400.0, 0.5e-6) / motion_sigma(
        SEEING, UP, 100.0, 0.5e-6) == pytest.approx(0.5, rel=0.01)


def test_photons_count_by_magnitude_exposure_and_airmass():
    dark = dataclasses.replace(SEEING, sky=25.0)
    at = photon_sigma(dark, UP, 5.0, 1.0)
    assert at == pytest.approx(2.0 * ARCSEC / 2.3548 / np.sqrt(1e7 * 10 ** (-0.4 * 5.2)), rel=1e-3)
    assert photon_sigma(dark, UP, 10.0, 1.0) / at == pytest.approx(10.0, rel=1e-2)
    assert photon_sigma(dark, UP, 5.0, 4.0) / at == pytest.approx(0.5, rel=1e-3)
    # 2^0.6 as wide, and 0.2 mag fainter
    assert photon_sigma(dark, LOW, 5.0, 1.0) / at == pytest.approx(2**0.6 * 10**0.04, rel=1e-2)
    # where the sky decides, with the flux itself
    bright = dataclasses.replace(SEEING, sky=10.0)
    assert photon_sigma(bright, UP, 16.0, 1.0) / photon_sigma(
        bright, UP, 13.5, 1.0) == pytest.approx(10.0, rel=0.05)


@pytest.fixture(scope='module')
def sky():
    """Stars of the start of the night: azimuth, elevation, frames that point at them."""
    az, el = observed_place(load_catalogue(4.5), NIGHT)
    up = el > 20.0 * DEG
    return az[up], el[up], MountGeometry(MountErrors()).frames(az[up], el[up])


def test_the_camera_has_the_noise_of_the_seeing(sky):
    az, el, frames = sky
    stamps = NIGHT * 10**9 + np.arange(len(az))  # a noise of its own each
    params = dataclasses.replace(SEEING, fwhm=5.0 * ARCSEC)
    seen, plain = (Camera(Scenario(seeing=s), 1, exposure=0.5).expose(stamps, frames)
                   for s in (params, Seeing()))
    noise = seen.miss - plain.miss
    sigma = seeing_sigma(params, el, seen.mag, 0.5, 0.55e-6)
    assert 1.2 < sigma.max() / sigma.min() < 2.0 and len(el) > 200
    for rows in (el < 40.0 * DEG, el > 50.0 * DEG):
        ratio = noise[rows] / sigma[rows, np.newaxis]
        assert np.std(ratio) == pytest.approx(1.0, abs=5.0 / np.sqrt(2.0 * ratio.size))
    one = Camera(Scenario(seeing=params), 1, exposure=0.5).expose(stamps[7:8], frames[7:8])
    assert one.miss == pytest.approx(seen.miss[7:8])


def test_refraction_about_layers_that_lean(sky):
    az, el, _ = sky
    constant, lean = 55.0 * ARCSEC, np.array([0.004, -0.003])
    air = TurbulentRefraction(AirLayers(lean=1.0 * DEG), constant, 1)
    size = 1.0 * DEG
    air._lean = [type('Lean', (), {'at': staticmethod(lambda t, v=v: np.full(len(t), v / size))})
                 for v in lean]
    new_az, new_el = azimuth_elevation(air.bent(np.zeros(len(az)), direction(az, el)))
    # exactly: refraction of constant * tan z about the leaning normal, less that about up
    normal = np.array([*lean, 1.0]) / np.linalg.norm([*lean, 1.0])
    s = direction(az, el)
    shift = constant * (normal / (s @ normal)[:, np.newaxis] - [0, 0, 1] / s[:, 2:])
    right = np.stack([np.cos(az), -np.sin(az), 0 * az], axis=1)
    above = np.stack([-np.sin(el) * np.sin(az), -np.sin(el) * np.cos(az), np.cos(el)], axis=1)
    x, y = (np.einsum('ni,ni->n', shift, axis) for axis in (right, above))
    assert np.abs(y).max() > 1.0 * ARCSEC
    assert wrap(new_az - az) * np.cos(el) == pytest.approx(x, abs=0.03 * ARCSEC)
    assert new_el - el == pytest.approx(y, abs=0.03 * ARCSEC)


def test_stars_wander_more_the_lower_they_are_and_neighbours_together(sky):
    az, el, frames = sky
    layers = AirLayers(lean=0.6 * DEG, correlation_time=600.0)
    spread = []
    for seed in range(12):
        wandering, level = (Camera(Scenario(layers=a), seed, start=NIGHT - 3000.0).expose(
            np.full(len(az), NIGHT * 10**9), frames).miss for a in (layers, AirLayers()))
        spread.append(wandering - level)
    spread = np.array(spread) / ARCSEC
    rms = np.sqrt(np.mean(spread[:, :, 1] ** 2, axis=0))
    low, high = rms[el < 25 * DEG].mean(), rms[el > 65 * DEG].mean()
    assert low > 4.0 * high and high == pytest.approx(0.65, rel=0.35)
