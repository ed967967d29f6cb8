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

"""Candidate effects against independent geometry; what they do when a driver is missing."""

import json

import erfa
import numpy as np
import pytest
from made_contexts import LATITUDE, LONGITUDE, make_columns, make_context

from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model import geometry
from pointing_model.context import Context
from pointing_model.effects import (
    PERIODS,
    changes,
    declared_graduation,
    dictionary,
    effect,
    effect_from_document,
    slips,
    smooths,
    steps,
    to_document,
)
from pointing_model.pointing_terms import design
from pointing_model.sky.star_catalogue import load_catalogue

RNG = np.random.default_rng(7)


def hour_frame(az, el):
    """Hour angle and declination."""
    sin_dec = np.sin(el) * np.sin(LATITUDE) + np.cos(el) * np.cos(LATITUDE) * np.cos(az)
    dec = np.arcsin(sin_dec)
    hour = np.arctan2(-np.sin(az) * np.cos(el),
                      np.sin(el) * np.cos(LATITUDE) - np.cos(el) * np.sin(LATITUDE) * np.cos(az))
    return hour, dec


def horizon(hour, dec, latitude=LATITUDE):
    el = np.arcsin(np.sin(dec) * np.sin(latitude)
                   + np.cos(dec) * np.cos(latitude) * np.cos(hour))
    az = np.arctan2(-np.cos(dec) * np.sin(hour),
                    np.sin(dec) * np.cos(latitude) - np.cos(dec) * np.sin(latitude) * np.cos(hour))
    return az, el


def on_sky(az, el, az0, el0):
    return np.array([wrap(az - az0) * np.cos(el0), el - el0])


def test_stored_models_keep_their_columns():
    """Effects that have more coefficients today than when a model was written."""
    context = make_context()
    step = effect('flop', axis='el', at=0.8, play=0.0).columns(context)
    assert step.shape[0] == 1 and not step[0, 0].any() and 0.0 < step[0, 1].mean() < 1.0
    for old, names in (
            (effect('cable_drag', axis='el', middle=0.0, half=4.0), ('line', 'cube')),
            (effect('bearing_cage', ratio=0.4, how='lean'),
             ('el_cos', 'el_sin', 'az_cos', 'az_sin'))):
        assert tuple(old.coefficient_names) == names
        context.columns['unwrapped_az'] = context.az
        columns = old.columns(context)
        assert len(columns) == len(names) and all(one.any() for one in columns)


def test_the_dictionary_holds_what_is_asked_for():
    effects, untestable = dictionary(make_context())
    names = {e.name for e in effects}
    # members of a scan are one effect, at one place or another
    single = [e.name for e in effects if e.scan is None]
    assert len(single) == len(set(single))
    lines = {}
    assert all(lines.setdefault(e.name, e.line) == e.line for e in effects)
    wanted = {
        'refraction', 'refraction_cube', 'second_flexure', 'annual_aberration',
        'diurnal_aberration', 'bent_to_one_side', 'precession_or_epoch_error',
        'proper_motion', 'latency',
        'camera_rotation', 'camera_scale', 'magnitude_equation_az', 'magnitude_equation_el',
        'pier_side_az', 'pier_side_el', 'azimuth_zero_per_run', 'elevation_zero_per_run',
        'humidity_pct_az', 'humidity_pct_el', 'clock_or_longitude', 'latitude',
        'fork_cross_term', 'elevation_axis_wobble_1', 'azimuth_hysteresis',
        'azimuth_hysteresis_cosE', 'azimuth_hysteresis_memory_10deg', 'elevation_hysteresis',
        'elevation_hysteresis_cosE', 'elevation_hysteresis_cosE_memory_10deg',
    }
    wanted |= {f'elevation_encoder_{k}' for k in (1, 2, 3)}
    wanted |= {f'azimuth_encoder_{k}' for k in range(1, 7)}
    wanted |= {f'azimuth_bearing_wobble_{k}' for k in (1, 2, 3)}
    wanted |= {f'line_of_sight_{k}' for k in (2, 3, 4)}
    wanted |= {f'{t}_with_{d}' for d in ('time', 'temperature') for t in (
        'azimuth_zero', 'elevation_zero', 'tilt', 'flexure', 'collimation')}
    wanted |= {'azimuth_zero_with_time_squared', 'elevation_zero_with_time_squared'}
    wanted |= {f'{a}_subdivision_{g}_{k}' for a in ('azimuth', 'elevation')
               for g in ('grating', 'bars') for k in (1, 2)}
    assert wanted <= names, wanted - names
    assert {form for form, _ in untestable} == {
        # too short, too few turns, one turn that may begin anew
        'a disc whose centre goes round', 'cage of the bearing', 'cable drag'}
    for e in effects:
        assert e.cause and e.formula and e.driver and e.look_at, e.name
    assert {e.name for e in steps(make_context())} == {'azimuth_zero_step', 'elevation_zero_step'}


@pytest.mark.parametrize('first, last, told', [
    (0.0, 359.9, False), (-179.9, 179.9, False), (-0.5, 360.5, False), (-90.0, 250.0, True),
    (60.0, 400.0, True)])
def test_readings_within_one_turn_do_not_count_what_winds_up_cables(first, last, told):
    reading = np.radians(np.linspace(first, last, 60))
    effects, untestable = dictionary(make_context(az=np.mod(reading, 2.0 * np.pi), az_enc=reading))
    cables = [e for e in effects if e.form == 'cable_drag']
    assert bool(cables) == told
    assert [effect_from_document(to_document(e)) for e in cables] == cables
    assert ('stay within one turn' in dict(untestable).get('cable drag', '')) != told


def test_every_effect_comes_back_from_its_document():
    context = make_context()
    effects = dictionary(context)[0]
    change = [c for e in effects[::8] for c in changes(e, context)]
    assert {c.driver for c in change} == {'time', 'temperature'}
    for e in effects + change + steps(context)[:2] + smooths(context)[::40]:
        again = effect_from_document(json.loads(json.dumps(to_document(e))))
        assert again == e
        columns = e.columns(context)
        assert columns.shape == (len(e.coefficient_names), 2, len(context))
        assert columns.any() and np.isfinite(columns).all(), e.name
        assert np.array_equal(again.columns(context), columns)
        if e.axes == 'az':
            assert not columns[:, 1].any(), e.name
        if e.axes == 'el':
            assert not columns[:, 0].any(), e.name


def test_missing_and_constant_drivers_are_named():
    context = make_context(drop=('temperature', 'pier_side', 'miss_x', 'time'),
                           magnitude=np.full(60, 3.0))
    effects, untestable = dictionary(context)
    reasons = dict(untestable)
    assert reasons['drift with temperature'] == 'temperature is not known'
    assert reasons['magnitude'] == 'magnitude does not vary'
    assert 'camera rotation and scale' in reasons and 'pier_side' in reasons
    # without times the order of the rows stands for them
    assert 'azimuth_zero_with_order' in {e.name for e in effects}


def test_unknown_driver_counts_as_zero():
    temperature = make_columns()['temperature'].copy()
    temperature[5] = np.nan
    e = effect('drift', of='IA', driver='temperature', origin=8.0)
    columns = e.columns(make_context(temperature=temperature))
    assert columns[0, 0, 5] == 0.0 and columns[0, 0, 6] != 0.0
    assert not e.columns(make_context(drop=('temperature',))).any()


def test_drift_and_curves_are_not_extrapolated_for_ever():
    context = make_context()
    time = context.columns['time']
    span = np.ptp(time)
    drift = next(e for e in dictionary(context)[0] if e.name == 'elevation_zero_with_time')
    later = Context(np.zeros(3), np.full(3, 0.5), {
        'time': time.max() + np.array([0.3, 0.5, 20.0]) * span})
    y = drift.columns(later)[0, 1]
    assert y[0] == pytest.approx((later.columns['time'][0] - time.mean()) / 3600.0)
    assert y[2] == y[1] > y[0]
    for curve in [e for e in smooths(context) if e.driver == 'time'][::15]:
        ends = curve.columns(context.at(context.az, np.full(60, 0.5), time=time.max()))
        beyond = curve.columns(context.at(context.az, np.full(60, 0.5), time=time.max() + 1e5))
        assert np.array_equal(ends, beyond), curve.name


def test_disc_off_its_centre():
    # a reading head looks at a disc whose centre lies d to the north of the axis, radius 1
    d, az = 3e-5, RNG.uniform(0.0, 2.0 * np.pi, 50)
    reading = np.arctan2(np.sin(az), np.cos(az) - d)
    context = Context(az, np.full(50, 0.8))
    x = effect('encoder', axis='az', order=1).columns(context)[:, 0]
    expected = wrap(reading - az) * np.cos(0.8)
    assert np.allclose(d * x[1], expected, atol=2e-9)
    assert not np.allclose(d * x[0], expected, atol=1e-6)


def test_wobble_is_a_tilt_that_turns_with_the_azimuth():
    # axis leans away from where the mount looks by w cos(2A): AN, AW of each row by rotations
    w, context = 20.0 * ARCSEC, make_context()
    az, el = context.az, context.el
    exact = np.array([geometry.offsets(a, e, {'AN': w * np.cos(2 * a)}) for a, e in zip(az, el)]).T
    # (sin A sin E, cos A) cos 2A is made of the first and third harmonics of the wobble
    columns = np.vstack([effect('bearing_wobble', order=k).columns(context).reshape(-1, 120)
                         for k in (1, 3)])
    p, *_ = np.linalg.lstsq(columns.T, exact.ravel(), rcond=None)
    assert np.abs(exact.ravel() - p @ columns).max() < 0.01 * ARCSEC


def test_clock_and_latitude_are_the_terms_that_they_are_said_to_be():
    context = make_context()
    hour, dec = hour_frame(context.az, context.el)
    late = 5.0 * ARCSEC
    # the sky seems ahead by `late` in hour angle
    moved = on_sky(*horizon(hour + late, dec), context.az, context.el)
    clock = effect('clock', latitude=LATITUDE).columns(context)[0]
    assert np.allclose(clock * late, moved, atol=1e-8 * late / ARCSEC + 1e-9)
    x, y = design(('IA', 'AW'), context.az, context.el)
    p, left, *_ = np.linalg.lstsq(np.vstack((x, y)), clock.ravel(), rcond=None)
    assert left[0] < 1e-20 and np.allclose(p, [np.sin(LATITUDE), -np.cos(LATITUDE)])
    moved = on_sky(*horizon(hour, dec, LATITUDE + late), context.az, context.el)
    north = effect('latitude').columns(context)[0]
    assert np.allclose(north * late, moved, atol=2e-8)


def test_latency_of_stars_is_a_clock_error_and_of_satellites_is_not():
    stars = make_context()
    clock = effect('clock', latitude=LATITUDE).columns(stars)[0]
    latency = effect('latency').columns(stars)[0]
    sidereal = 15.0410686  # "/s
    assert np.allclose(latency, sidereal * clock, atol=1e-5)
    fast = make_context(az_rate=RNG.normal(size=60) * 1e-3, el_rate=RNG.normal(size=60) * 1e-3)
    late = effect('latency').columns(fast)[0] * 0.1 * ARCSEC  # 0.1 s
    assert np.allclose(late[0], 0.1 * fast.columns['az_rate'] * np.cos(fast.el))
    assert np.allclose(late[1], 0.1 * fast.columns['el_rate'])


def test_places_of_another_equinox():
    context = make_context()
    lst = context.get('lst')
    hour, dec = hour_frame(context.az, context.el)
    place = erfa.s2c(lst - hour, dec)
    # rotate all stars about the equatorial X axis by 30"
    angle = 30.0 * ARCSEC
    rotated = place @ np.array([[1, 0, 0], [0, np.cos(angle), np.sin(angle)],
                                [0, -np.sin(angle), np.cos(angle)]])
    ra, new_dec = erfa.c2s(rotated)
    moved = on_sky(*horizon(lst - ra, new_dec), context.az, context.el)
    columns = effect('epoch_error').columns(context)
    assert np.abs(columns[0] * angle - moved).max() < 0.01 * ARCSEC
    assert np.abs(columns[1] * angle - moved).max() > ARCSEC


def test_annual_aberration_is_a_dipole_toward_the_velocity():
    context = make_context()
    lst = context.get('lst')
    hour, dec = hour_frame(context.az, context.el)
    place = erfa.s2c(lst - hour, dec)
    v = np.array([0.3, -0.8, 0.35]) * 1e-4
    seen = place + v
    ra, new_dec = erfa.c2s(seen / np.linalg.norm(seen, axis=1)[:, None])
    moved = on_sky(*horizon(lst - ra, new_dec), context.az, context.el)
    columns = effect('annual_aberration').columns(context)
    assert np.abs(np.tensordot(v, columns, 1) - moved).max() < 0.01 * ARCSEC
    east = effect('diurnal_aberration').columns(context)[0]
    seen = np.array([np.cos(context.el) * np.sin(context.az) + 1e-6,
                     np.cos(context.el) * np.cos(context.az), np.sin(context.el)])
    moved = on_sky(np.arctan2(seen[0], seen[1]), np.arctan2(seen[2], np.hypot(*seen[:2])),
                   context.az, context.el)
    assert np.allclose(east * 1e-6, moved, atol=1e-10)
    # the wind bends the tube to the north as to the east
    columns = effect('bent_to_one_side').columns(context)
    assert np.array_equal(columns[0], east)
    assert np.allclose(columns[1], [-np.sin(context.az),
                                    -np.sin(context.el) * np.cos(context.az)])


def test_proper_motion_left_out():
    stars = load_catalogue(hip=[37279, 11767, 69673, 97649] * 15)
    context = make_context()
    hour = context.get('lst') - stars.ra
    az, el = horizon(hour, stars.dec)
    years = 50.0
    later = horizon(hour - years * stars.pm_ra_cosdec / np.cos(stars.dec),
                    stars.dec + years * stars.pm_dec)
    columns = {**context.columns, 'star': stars.hip}
    column = effect('proper_motion').columns(
        Context(az, el, columns, LATITUDE, LONGITUDE))[0] * ARCSEC
    up = el > 0.1
    moved = on_sky(*later, az, el)
    assert np.abs(column * years - moved)[:, up].max() < 0.1 * ARCSEC
    assert np.abs(moved[:, up]).max() > 20.0 * ARCSEC


def test_mean_sidereal_time():
    context = make_context()
    time = context.columns['time']
    jd = 2440587.5 + time / 86400.0
    expected = erfa.gmst82(jd, 0.0) + LONGITUDE
    assert np.abs(wrap(context.get('lst') - expected)).max() < 20.0 * ARCSEC


def test_hysteresis_and_its_memory():
    az = np.array([0.0, 40.0, 30.0, 29.0]) * DEG
    context = Context(az, np.full(4, 0.7), {
        'az_enc': az, 'approach_az': np.array([0.0, 1.0, -1.0, -1.0])})
    plain = effect('hysteresis', axis='az').columns(context)[0, 0]
    assert plain.tolist() == [0.0, 1.0, -1.0, -1.0]
    faded = effect('hysteresis', axis='az', memory_deg=5.0).columns(context)[0, 0]
    # the second row comes from 0 over 40 degrees, the third turns back over 10
    assert faded[1] == pytest.approx(1.0 - np.exp(-8.0), abs=1e-9)
    assert faded[2] == pytest.approx(-1.0 + 2.0 * np.exp(-2.0))
    cosine = effect('hysteresis', axis='az', shape='cosE').columns(context)[0, 0]
    assert np.allclose(cosine, plain * np.cos(0.7))


def test_a_slew_goes_the_way_from_which_it_came():
    az = np.array([10.0, 350.0, 20.0, 60.0]) * DEG
    for side, expected in (
            (None, [-20.0, 30.0, 40.0]),  # an encoder of one turn: the short way
            ([1.0, 1.0, -1.0, 1.0], [340.0, -330.0, 40.0]),  # never through the end of its circle
            ([1.0, -1.0, 1.0, 1.0], [-20.0, 30.0, 40.0]),
            ([1.0, 1.0, 1.0, 1.0], [-20.0, 30.0, 40.0])):  # the last degrees, always from there
        columns = {'az_enc': az} | ({} if side is None else {'approach_az': np.array(side)})
        slew = Context(az, np.full(4, 0.7), columns).get('slew_az')
        assert slew[1:] / DEG == pytest.approx(expected)


def test_the_long_slews_of_a_grid_are_not_those_that_the_error_makes_longest():
    el = np.concatenate([np.linspace(20.0, 80.0, 8)[::turn] for turn in (1, -1) * 6]) * DEG
    reading = el + 3.0 * ARCSEC * np.random.default_rng(3).normal(size=len(el))
    grid = {'el_enc': reading, 'time': 60.0 * np.arange(len(el))}
    az = np.repeat(np.arange(12) * 30.0, 8) * DEG
    assert not [one for offer in slips.propose(Context(az, el, grid), (), ())
                for one in offer.effects if one.axes == 'el']
    apart = np.random.default_rng(4).uniform(20.0, 80.0, len(el)) * DEG
    assert [one for offer in slips.propose(
        Context(az, apart, grid | {'el_enc': apart}), (), ()) for one in offer.effects]


def test_the_line_of_sight_turns_with_the_mirror_that_bends_it():
    # a beam that leaves the azimuth axis' plane by an angle that goes twice round a turn
    rng = np.random.default_rng(8)
    az, el = rng.uniform(0.0, 2.0 * np.pi, 40), rng.uniform(0.3, 1.3, 40)
    left = 20.0 * ARCSEC * np.sin(2.0 * az)
    beside = np.arctan2(np.tan(left), np.cos(el))  # of an exact collimation
    columns = effect('line_of_sight', order=2).columns(Context(az, el))
    assert not columns[:, 1].any()
    assert np.abs(20.0 * columns[1, 0] - beside * np.cos(el) / ARCSEC).max() < 1e-3
    assert effect('line_of_sight', order=2).tpoint == 'HSCA2 HSSA2'


def test_a_declared_graduation_is_the_one_that_is_divided():
    context = make_context()
    context.graduation = declared_graduation('az.grating=36000')
    names = {e.name: e for e in dictionary(context)[0] if e.form == 'subdivision'}
    assert {n for n in names if n.startswith('azimuth')} == {
        'azimuth_subdivision_grating_1', 'azimuth_subdivision_grating_2'}
    assert names['azimuth_subdivision_grating_1'].parameters['lines'] == 36000
    assert '36"' in names['azimuth_subdivision_grating_1'].cause
    for wrong in ('grating=27.5', 'bars', 'ring=1000', 'ra.bars=1080', 'grating=3', 'bars=x'):
        with pytest.raises(ValueError, match='graduation'):
            declared_graduation(wrong)
    assert declared_graduation({'bars': 1080}) == declared_graduation(
        declared_graduation('bars = 1080')) == {'az': {'bars': 1080}, 'el': {'bars': 1080}}


def test_subdivision_follows_the_raw_reading():
    n = 400
    az = RNG.uniform(0.0, 2.0 * np.pi, n)
    raw = az + 1.234  # zero not taken off
    error = 3.0 * ARCSEC * np.sin(2.0 * np.pi * raw / PERIODS['grating'] + 0.4)
    e = effect('subdivision', axis='az', graduation='grating', order=1)
    context = Context(az, np.full(n, 0.5), {'az_raw': raw, 'az_enc': az})
    wrapped = Context(az, np.full(n, 0.5), {'az_raw': raw + 2.0 * np.pi, 'az_enc': az})
    columns = e.columns(context)[:, 0]
    p, *_ = np.linalg.lstsq(columns.T, error * np.cos(0.5), rcond=None)
    assert np.hypot(*p) == pytest.approx(3.0 * ARCSEC, rel=1e-6)
    assert np.allclose(columns, e.columns(wrapped)[:, 0], atol=1e-6)
    assert PERIODS['grating'] / ARCSEC == pytest.approx(27.457627) and \
        PERIODS['bars'] / ARCSEC == pytest.approx(1200.0)
    # the miss distance is no part of the reading
    missed = Context(az, np.full(n, 0.5), {
        'az_enc': raw + 8.0 * ARCSEC / np.cos(0.5), 'miss_x': np.full(n, 8.0 * ARCSEC)})
    assert np.allclose(columns, e.columns(missed)[:, 0], atol=1e-6)


def test_camera_turned():
    context = make_context()
    angle = 0.002
    m = np.array([context.columns['miss_x'], context.columns['miss_y']])
    turned = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ m
    column = effect('camera', of='rotation').columns(context)[0] * ARCSEC
    assert np.allclose(column * angle, turned - m, atol=1e-10)


@pytest.mark.parametrize('aim, told', [(1.0, False), (4.0, False), (60.0, True)])
def test_the_noise_of_centred_stars_is_no_scale_of_the_camera(aim, told):
    """It is in the miss distance and in the offset alike."""
    n, rng = 120, np.random.default_rng(3)
    missed, noise = rng.normal(size=(2, n)) * aim * ARCSEC, rng.normal(size=(2, n)) * ARCSEC
    columns = make_columns(n)
    x, y = noise  # the star's place is what the encoders read and what the camera measured
    columns.update(az_enc=columns['az'] + x / np.cos(columns['el']), el_enc=columns['el'] + y,
                   miss_x=missed[0] + x, miss_y=missed[1] + y,
                   star=np.arange(n), run=np.repeat([4, 9], n // 2))
    context = Context(columns.pop('az'), columns.pop('el'), columns)
    effects, untestable = dictionary(context)
    names, reasons = {e.name for e in effects}, dict(untestable)
    assert 'camera_rotation' in names and ('camera_scale' in names) == told
    assert ('looks like a scale' in reasons.get('camera scale', '')) != told


@pytest.mark.parametrize('family, parameters, text', [
    ('no_such', {}, 'unknown effect'), ('encoder', {'axis': 'az'}, 'wrong parameters'),
    ('drift', {'of': 'XX', 'driver': 'time'}, 'wrong parameters'),
])
def test_bad_effects(family, parameters, text):
    with pytest.raises(ValueError, match=text):
        effect(family, **parameters)
