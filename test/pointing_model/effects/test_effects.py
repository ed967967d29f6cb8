"""Candidate effects against independent geometry; what they do when a driver is missing."""

import json
import re

import erfa
import numpy as np
import pytest

from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model import geometry
from pointing_model.context import Context
from pointing_model.effects import (
    PERIODS,
    changes,
    declared_graduation,
    dictionary,
    effect,
    of_document,
    smooths,
    steps,
    to_document,
)
from pointing_model.fitted_effects import FittedEffect
from pointing_model.model import PointingModel
from pointing_model.model_document import from_document
from pointing_model.run import PointingRun
from pointing_model.star_catalogue import load_catalogue
from pointing_model.terms import PHYSICAL, TERMS, design, stacked_design

LATITUDE, LONGITUDE = 34.3 * DEG, 109.0 * DEG
RNG = np.random.default_rng(7)


def make_columns(n=60, seed=1):
    rng = np.random.default_rng(seed)
    az = rng.uniform(0.0, 2.0 * np.pi, n)
    el = np.arcsin(rng.uniform(0.35, 0.99, n))
    return {
        'az': az, 'el': el, 'az_enc': az + 0.001, 'el_enc': el - 0.001,
        'time': 1.6e9 + np.cumsum(rng.uniform(50.0, 150.0, n)),
        'temperature': rng.normal(8.0, 2.0, n), 'approach_az': rng.choice([-1.0, 1.0], n),
        'approach_el': rng.choice([-1.0, 1.0], n), 'magnitude': rng.uniform(1.0, 6.0, n),
        'miss_x': rng.normal(size=n) * ARCSEC, 'miss_y': rng.normal(size=n) * ARCSEC,
        'pier_side': rng.choice([-1.0, 1.0], n), 'humidity_pct': rng.uniform(20.0, 80.0, n),
        'star': np.array([11767, 32349, 24436] * (n // 3)), 'run': np.repeat([4, 9], n // 2),
    }


def make_context(n=60, seed=1, drop=(), **more):
    columns = {k: v for k, v in {**make_columns(n, seed), **more}.items() if k not in drop}
    return Context(columns.pop('az'), columns.pop('el'), columns, LATITUDE, LONGITUDE)


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


def test_the_dictionary_holds_what_is_asked_for():
    effects, untestable = dictionary(make_context())
    names = {e.name for e in effects}
    assert len(names) == len(effects)
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
    assert not untestable
    for e in effects:
        assert e.cause and e.formula and e.driver and e.look_at, e.name
    assert {e.name for e in steps(make_context())} == {'azimuth_zero_step', 'elevation_zero_step'}


def test_every_effect_comes_back_from_its_document():
    context = make_context()
    effects = dictionary(context)[0]
    change = [c for e in effects[::8] for c in changes(e, context)]
    assert {c.driver for c in change} == {'time', 'temperature'}
    for e in effects + change + steps(context)[:2] + smooths(context)[::40]:
        again = of_document(json.loads(json.dumps(to_document(e))))
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
    for wrong in ('grating=27.5', 'bars', 'tape=1000', 'ra.bars=1080', 'grating=3', 'bars=x'):
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


# ------------------------------------------------------------------------------ in the model

def make_model(*effects):
    terms = dict(zip(PHYSICAL, np.array([20.0, -35.0, 25.0, -18.0, 30.0, -22.0, 15.0]) * ARCSEC))
    return PointingModel(terms, effects=effects)


def fitted(family, values, **parameters):
    e = effect(family, **parameters)
    return FittedEffect(e, np.array(values) * ARCSEC, np.full(len(values), 0.1) * ARCSEC)


def test_model_applies_an_effect_by_its_driver():
    step = fitted('step', [7.0], axis='el', at=1000.0)
    model, plain = make_model(step), make_model()
    az, el = np.array([0.3, 2.0, 4.0]), np.array([0.5, 0.9, 1.3])
    x0, y0 = plain.offsets(az, el)
    x, y = model.offsets(az, el, {'time': np.array([999.0, 1001.0, np.nan])})
    assert np.allclose(x, x0, atol=1e-15)
    assert np.allclose((y - y0) / ARCSEC, [0.0, 7.0, 0.0], atol=1e-9)
    assert np.allclose(model.offsets(az, el)[1], y0, atol=1e-15)
    unknown = model.unknown(az, el, {'time': np.array([999.0, 1001.0, np.nan])})
    assert unknown['elevation_zero_step'].tolist() == [False, False, True]
    assert model.unknown(az, el, {'time': 5.0}) == {}
    sx, sy = model.sigma(az, el, {'time': 1001.0})
    assert np.allclose(sy, 0.1 * ARCSEC) and not sx.any()


def test_model_goes_there_and_back_with_effects():
    context = {'approach_az': 1.0, 'temperature': 12.0}
    model = make_model(
        fitted('hysteresis', [3.0], axis='az', shape='cosE'),
        fitted('drift', [0.5, -0.4], of='tilt', driver='temperature', origin=8.0),
        fitted('subdivision', [2.0, 1.0], axis='az', graduation='grating', order=1))
    az, el = RNG.uniform(0.0, 6.0, (3, 20)), RNG.uniform(0.3, 1.4, (3, 20))
    az_enc, el_enc = model.sky_to_encoder(az, el, context)
    assert az_enc.shape == (3, 20)
    # the subdivision error at the angle that the encoder will read
    again = model.sky_to_encoder(az.ravel(), el.ravel(), {
        **context, 'az_enc': az_enc.ravel(), 'el_enc': el_enc.ravel()})
    assert np.abs(wrap(again[0] - az_enc.ravel())).max() < 0.3 * ARCSEC
    az_back, el_back = model.encoder_to_sky(*again, context={
        **context, 'az_raw': az_enc.ravel(), 'el_raw': el_enc.ravel()})
    assert np.abs(wrap(az_back - az.ravel())).max() < 1e-6 * ARCSEC
    assert np.abs(el_back - el.ravel()).max() < 1e-6 * ARCSEC
    alone = make_model(fitted('hysteresis', [3.0], axis='az', shape='cosE'))
    assert model.sky_to_encoder(0.3, 0.5, context)[0] != alone.sky_to_encoder(0.3, 0.5, context)[0]


def test_residuals_take_the_drivers_from_the_run():
    columns = make_columns()
    model = make_model(fitted('hysteresis', [4.0], axis='el'))
    x, y = model.offsets(columns['az'], columns['el'], {'approach_el': columns['approach_el']})
    columns['az_enc'] = columns['az'] + x / np.cos(columns['el'])
    columns['el_enc'] = columns['el'] + y
    left = model.residuals(PointingRun(columns))
    assert np.abs(left).max() < 1e-9 * ARCSEC
    wrong = make_model(fitted('hysteresis', [-4.0], axis='el')).residuals(PointingRun(columns))
    assert np.abs(wrong[1]).min() > 7.9 * ARCSEC


def test_document_with_effects_to_the_bit():
    model = make_model(fitted('hysteresis', [np.pi], axis='az'),
                       fitted('smooth', [1.0, 2.0, 1 / 3], axis='el', driver='elevation',
                              shape='spline', knots=[0.2, 0.5, 0.9, 1.3]))
    text = model.to_json()
    assert json.loads(text)['version'] == 2
    again = PointingModel.from_json(text)
    assert again.to_json() == text
    for one, two in zip(model.effects, again.effects):
        assert np.array_equal(one.coefficients, two.coefficients) and one.effect == two.effect
    assert json.loads(make_model().to_json())['version'] == 1
    document = json.loads(text)
    document['effects'][0]['coefficients'][0]['name'] = 'other'
    with pytest.raises(ValueError, match='damaged.*half_difference'):
        from_document(document)
    document = json.loads(text)
    document['effects'][0]['family'] = 'nothing'
    with pytest.raises(ValueError, match='damaged.*unknown effect'):
        from_document(document)


def run_at(az, el, noise=1.0, seed=3, **columns):
    """A run with indices, a tilt and noise of the readings (arcsec)."""
    rng = np.random.default_rng(seed)
    return PointingRun({
        'az': az, 'el': el, 'az_enc': az + 50.0 * ARCSEC + rng.normal(0.0, noise, len(az)) * ARCSEC,
        'el_enc': el + rng.normal(0.0, noise, len(az)) * ARCSEC, **columns})


def offered(run):
    return {e.name for e in dictionary(Context.of_run(run))[0]}


def test_stars_at_one_elevation_show_no_subdivision_of_its_encoder():
    """The reading then runs through the period by its own error alone."""
    rng = np.random.default_rng(3)
    az = rng.uniform(0.0, 2.0 * np.pi, 60)
    for el, shown in ((np.full(60, 0.7), False), (rng.uniform(0.4, 1.4, 60), True)):
        names = offered(run_at(az, el, 5.0))
        assert ('elevation_subdivision_grating_1' in names) == shown
        assert 'azimuth_subdivision_grating_1' in names


@pytest.mark.parametrize('fixed, noise', [([3.0], 1.0), ([3.0], 8.0), ([0.0], 1.0),
                                          ([0.1, np.pi + 0.1], 1.0), ([0.3, 1.5, 2.7], 5.0)])
def test_an_encoder_that_stays_shows_no_subdivision(fixed, noise):
    """The places are spread by tilt and collimation; the readings by their noise alone."""
    rng = np.random.default_rng(4)
    el = rng.uniform(0.4, 1.4, 60)
    az = np.resize(fixed, 60)
    run = run_at(az + 60.0 * ARCSEC * rng.standard_normal(60), el)
    run.columns['az_enc'] = az + noise * ARCSEC * rng.standard_normal(60)
    names = offered(run)
    assert 'elevation_subdivision_grating_1' in names
    assert not any(name.startswith('azimuth_subdivision') for name in names)
    reasons = dict(dictionary(Context.of_run(run))[1])
    assert 'noise alone' in reasons['azimuth encoder subdivision (grating)']


def test_a_level_of_single_rows_carries_no_effect():
    rng = np.random.default_rng(5)
    az, el = rng.uniform(0.0, 6.0, 40), rng.uniform(0.4, 1.4, 40)
    for first, shown in (([0.0], False), ([-1.0, -1.0, 0.0], False), ([-1.0] * 3, True),
                         ([np.nan, -1.0, -1.0, -1.0], True)):
        sign = np.append(first, np.ones(40 - len(first)))
        run = run_at(az, el, approach_el=sign, pier_side=sign)
        names, reasons = offered(run), dict(dictionary(Context.of_run(run))[1])
        for name in ('elevation_hysteresis', 'elevation_hysteresis_memory_3deg'):
            assert (name in names) == shown, first
        assert ('elevation hysteresis' in reasons) != shown
        assert ('pier_side_az' in names) == shown
        assert ('pier_side' in reasons) != shown
    assert dict(dictionary(Context.of_run(run_at(
        az, el, approach_el=np.append(0.0, np.ones(39)))))[1])['elevation hysteresis'] == \
        'approach_el is -1 in only 0 of 40 rows'


def test_the_row_before_is_the_one_before_in_time():
    columns = make_columns()
    columns['run'] = np.repeat([4, 9], 30)
    sorted_run = Context.of_run(PointingRun(columns))
    rows = np.random.default_rng(6).permutation(60)
    mixed = {name: v[rows] for name, v in columns.items()}
    for name in ('order', 'travel_az', 'travel_el', 'before_az', 'before_el', 'run_hours'):
        np.testing.assert_array_equal(Context.of_run(PointingRun(mixed)).get(name),
                                      sorted_run.get(name)[rows], name)
    assert np.isnan(sorted_run.get('travel_az')[[0, 30]]).all()
    # a time that is not known in some row: the order of the rows
    mixed['time'] = np.append(np.nan, mixed['time'][1:])
    mixed['run'] = columns['run']
    travel = Context.of_run(PointingRun(mixed)).get('travel_el')
    np.testing.assert_allclose(travel[1:30], np.abs(np.diff(mixed['el_enc'][:30])))
    assert np.isnan(travel[[0, 30]]).all()


def make_nights(gap_hours, n=30, nights=3):
    rng = np.random.default_rng(8)
    k = n * nights
    time = np.concatenate([1.6e9 + i * gap_hours * 3600.0 + np.sort(rng.uniform(0.0, 7200.0, n))
                           for i in range(nights)])
    return run_at(rng.uniform(0.0, 6.0, k), rng.uniform(0.4, 1.4, k), time=time,
                  run=np.repeat(np.arange(nights), n))


def test_a_drift_of_every_night_has_a_driver_of_its_own():
    run = make_nights(24.0)
    context = Context.of_run(run)
    hours = context.get('run_hours')
    assert (hours[::30] == 0.0).all() and hours.max() < 2.0
    assert hours[40] == pytest.approx((run['time'][40] - run['time'][30]) / 3600.0)
    effects = dictionary(context)[0]
    names = {e.name for e in effects}
    for clock in ('time', 'run_hours'):
        assert {f'{t}_with_{clock}' for t in (
            'azimuth_zero', 'elevation_zero', 'tilt', 'flexure', 'collimation',
            'azimuth_zero', 'elevation_zero')} <= names
        assert f'elevation_zero_with_{clock}_squared' in names
    # where each run has zeros of its own, their linear drifts are the same
    own = {e.name for e in dictionary(context, own=('IA', 'IE'))[0]}
    assert names - own == {'azimuth_zero_with_time', 'elevation_zero_with_time'}
    assert {e.driver for e in smooths(context)} >= {'time', 'run_hours'}
    drift = next(e for e in effects if e.name == 'elevation_zero_with_run_hours')
    assert drift.unit == 'arcsec/h'
    # another night, alone; a pointing does not know when its run began
    alone = PointingRun({n: v[30:60] for n, v in run.columns.items() if n != 'run'})
    np.testing.assert_allclose(drift.columns(Context.of_run(alone)),
                               drift.columns(context)[..., 30:60], atol=1e-12)
    assert not drift.columns(Context(0.3, 0.5, {'time': 1.6e9})).any()
    later = context.at(context.az, context.el, time=run['time'] + 3600.0)
    assert later.get('run_hours') is None and context.get('run_hours') is not None
    assert context.at(context.az, context.el).get('run_hours') is not None


@pytest.mark.parametrize('run', [
    make_nights(3.0), make_nights(24.0, nights=1),
    PointingRun({n: v for n, v in make_nights(24.0).columns.items() if n != 'run'}),
    PointingRun({n: v for n, v in make_nights(24.0).columns.items() if n != 'time'})])
def test_one_night_and_one_run_have_one_clock(run):
    context = Context.of_run(run)
    candidates = dictionary(context)[0] + smooths(context)
    assert not [e.name for e in candidates if e.driver == 'run_hours']


def test_what_is_proportional_is_held_beyond_what_was_seen():
    context = make_context()
    effects = {e.name: e for e in dictionary(context)[0]}
    for name, driver in (('magnitude_equation_az', 'magnitude'), ('camera_scale', 'miss_x'),
                         ('camera_rotation', 'miss_x')):
        seen = np.nanmax(np.abs(effects[name].columns(context)))
        far = make_context(**{d: 100.0 * context.get(d) for d in ('magnitude', 'miss_x', 'miss_y')})
        assert 1.2 * seen < np.abs(effects[name].columns(far)).max() < 2.5 * seen, driver


def test_changes_are_offered_of_what_does_not_change_already():
    context = make_context()
    for e in (*dictionary(context)[0], *steps(context)[:2], *smooths(context)[:3]):
        of_time = e.driver in ('time', 'temperature', 'run') or e.kind == 'smooth'
        assert bool(changes(e, context)) is not of_time, e.name
        assert not any(changes(c, context) for c in changes(e, context))
    nights = Context.of_run(make_nights(24.0))
    assert 'run_hours' in {c.driver for e in dictionary(nights)[0] for c in changes(e, nights)}


def test_terms_that_the_base_lacks():
    context = make_context()
    plain = dictionary(context)[0]
    effects = dictionary(context, lacking=tuple(TERMS))[0]
    terms = {e.name: e for e in effects if e.form == 'term'}
    # the columns of these three are there under other names, as is the latitude's
    assert set(terms) == set(TERMS) - {'TX', 'TX3', 'ECES'}
    assert {e.name for e in plain} - {e.name for e in effects} == {
        'latitude', 'elevation_axis_wobble_1', 'elevation_axis_wobble_2'}
    assert dict(dictionary(context, lacking=['NPAE', 'TF'])[1])['elevation axis wobble'] == \
        'it looks like terms that the model lacks: NPAE'
    assert dictionary(context, lacking=['TF'])[0] == [effect('term', name='TF'), *plain]
    for name, e in terms.items():
        columns = e.columns(context)
        np.testing.assert_array_equal(columns.reshape(1, -1),
                                      stacked_design([name], context.az, context.el))
        assert e.tpoint == name and e.driver in ('azimuth', 'elevation') and e.cause
        assert e.axes == ('both' if columns.any(axis=(0, 2)).all() else
                          'az' if columns[0, 0].any() else 'el')
        # the formula, read as it is
        s = {'sin': np.sin, 'cos': np.cos}
        for column, text in zip(columns[0], e.formula.strip('()').split(', ')):
            value = 1.0
            for f, k, of in re.findall(r'(sin|cos) (\d?)([AE])', text):
                value = value * s[f](int(k or 1) * (context.az if of == 'A' else context.el))
            value = 0.0 if text == '0' else -value if text.startswith('-') else value
            np.testing.assert_allclose(column, value, atol=1e-12)
    with pytest.raises(ValueError, match='effect term.*NOPE'):
        dictionary(context, lacking=('NOPE',))


def test_a_lacking_term_acts_as_the_base_would():
    value = 18.0
    model = PointingModel({'IA': 0.0, 'CA': 0.0}, effects=[fitted('term', [value], name='NPAE')])
    full = PointingModel({'IA': 0.0, 'CA': 0.0, 'NPAE': value * ARCSEC})
    az, el = RNG.uniform(0.0, 6.0, 20), RNG.uniform(0.3, 1.2, 20)
    for one, two in zip(model.offsets(az, el), full.offsets(az, el)):
        assert np.abs(one - two).max() < 0.01 * ARCSEC
    again = PointingModel.from_json(model.to_json())
    assert again.effects[0].effect == effect('term', name='NPAE')
    assert again.to_json() == model.to_json()


def test_air_pressure_is_a_driver_and_the_sidereal_time_is_none_of_the_users_own():
    pressure = np.linspace(740.0, 745.0, 60)
    context = make_context(pressure=pressure, lst=np.linspace(0.1, 1.0, 60))
    assert context.extra() == ['humidity_pct', 'pressure']
    assert {'pressure_az', 'pressure_az_angle', 'pressure_el'} <= {
        e.name for e in dictionary(context)[0]}
    assert 'pressure' in {e.driver for e in smooths(context)}
    reasons = dict(dictionary(make_context(pressure=np.full(60, 740.0)))[1])
    assert reasons['pressure'] == 'pressure does not vary'
    hours = make_context(lst_h=np.full(60, 6.0)).get('lst')
    assert np.allclose(hours, np.pi / 2.0)
