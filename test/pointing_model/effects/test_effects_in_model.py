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

"""Effects in a model and its document, and which of them a run may be asked about."""

import json
import re

import numpy as np
import pytest
from made_contexts import make_columns, make_context

from msg_tools.units import ARCSEC, wrap
from pointing_model.context import Context
from pointing_model.effects import (
    changes,
    dictionary,
    effect,
    smooths,
    steps,
)
from pointing_model.fitted_effects import FittedEffect
from pointing_model.model import PointingModel
from pointing_model.model_document import from_document
from pointing_model.pointing_terms import PHYSICAL, TERMS, stacked_design
from pointing_model.runs.run import PointingRun

RNG = np.random.default_rng(7)


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
    return {e.name for e in dictionary(Context.from_run(run))[0]}


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
    reasons = dict(dictionary(Context.from_run(run))[1])
    assert 'noise alone' in reasons['azimuth encoder subdivision (grating)']


def test_a_level_of_single_rows_carries_no_effect():
    rng = np.random.default_rng(5)
    az, el = rng.uniform(0.0, 6.0, 40), rng.uniform(0.4, 1.4, 40)
    for first, shown in (([0.0], False), ([-1.0, -1.0, 0.0], False), ([-1.0] * 3, True),
                         ([np.nan, -1.0, -1.0, -1.0], True)):
        sign = np.append(first, np.ones(40 - len(first)))
        run = run_at(az, el, approach_el=sign, pier_side=sign)
        names, reasons = offered(run), dict(dictionary(Context.from_run(run))[1])
        for name in ('elevation_hysteresis', 'elevation_hysteresis_memory_3deg'):
            assert (name in names) == shown, first
        assert ('elevation hysteresis' in reasons) != shown
        assert ('pier_side_az' in names) == shown
        assert ('pier_side' in reasons) != shown
    assert dict(dictionary(Context.from_run(run_at(
        az, el, approach_el=np.append(0.0, np.ones(39)))))[1])['elevation hysteresis'] == \
        'direction of approach in elevation is -1 in only 0 of 40 rows'


def test_the_row_before_is_the_one_before_in_time():
    columns = make_columns()
    columns['run'] = np.repeat([4, 9], 30)
    sorted_run = Context.from_run(PointingRun(columns))
    rows = np.random.default_rng(6).permutation(60)
    mixed = {name: v[rows] for name, v in columns.items()}
    for name in ('order', 'travel_az', 'travel_el', 'before_az', 'before_el', 'run_hours'):
        np.testing.assert_array_equal(Context.from_run(PointingRun(mixed)).get(name),
                                      sorted_run.get(name)[rows], name)
    assert np.isnan(sorted_run.get('travel_az')[[0, 30]]).all()
    # a time that is not known in some row: the order of the rows
    mixed['time'] = np.append(np.nan, mixed['time'][1:])
    mixed['run'] = columns['run']
    travel = Context.from_run(PointingRun(mixed)).get('travel_el')
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
    context = Context.from_run(run)
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
    np.testing.assert_allclose(drift.columns(Context.from_run(alone)),
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
    context = Context.from_run(run)
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
    nights = Context.from_run(make_nights(24.0))
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
