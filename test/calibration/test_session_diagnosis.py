import json

import numpy as np
import pytest

from calibration.nights import NightSeries
from calibration.rows import for_fitting, is_kept_out
from calibration.session import CalibrationSession
from calibration.session_diagnosis import FORMAT
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.model import PointingModel
from pointing_model.run import PointingRun
from pointing_model.star_catalogue import POLARIS_HIP
from pointing_model.terms import PHYSICAL
from pointing_model.zero import RunZero, Zeros

MOUNT = PointingModel(dict(zip(PHYSICAL, np.array([310, -170, 46, -23, 37, -21, 15]) * ARCSEC)))
DRIFT = np.array([20.0, -12.0]) * ARCSEC  # of the second power-on
START = 1_768_482_000.0
SITE = {'latitude': 34.3 * DEG, 'longitude': 109.0 * DEG}


def block(n, seed, *, run=1, zero=(0.0, 0.0), eccentric=0.0, check=0.0, polaris=False):
    """Stars (or Polaris) through `MOUNT`, whose azimuth disc lies off its axis (arcsec)."""
    rng = np.random.default_rng(seed)
    az, el = rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(0.35, 0.99, n))
    if polaris:
        az, el = 0.3 * DEG + 1e-4 * np.arange(n), 34.9 * DEG + 1e-5 * np.arange(n)
    az_enc, el_enc = MOUNT.sky_to_encoder(az, el)
    x, y = rng.normal(size=(2, n)) * 0.7 * ARCSEC
    return PointingRun({
        'time': START + 1e5 * run + 1e4 * seed + 15.0 * np.arange(n), 'az': az, 'el': el,
        'az_enc': az_enc + zero[0] + eccentric * ARCSEC * np.cos(az - 0.8) + x / np.cos(el),
        'el_enc': el_enc + zero[1] + y, 'run': np.full(n, float(run)),
        'star': np.full(n, float(POLARIS_HIP)) if polaris else 1000.0 * seed + np.arange(n),
        'check': np.full(n, check), 'miss_x': np.zeros(n), 'miss_y': np.zeros(n)})


def session(*blocks, fit=True, **options):
    out = CalibrationSession(**options)
    for number, rows in enumerate(blocks):
        out.add(rows, (number + 1) * 10**9)
    if fit:
        out.calibrate_zero()
        out.fit()
    return out


def test_the_effect_is_added_and_stars_that_nothing_has_seen_gain():
    night = session(block(70, 1, eccentric=8.0), block(8, 2, eccentric=8.0, polaris=True),
                    block(25, 3, eccentric=8.0, check=1.0))
    found = night.diagnose(site=SITE)
    assert found.document['verdict'] == 'identified'
    assert found.document['applied'] == ['azimuth_encoder_1']
    cos, sin = (found.model.effects[0].coefficients / ARCSEC)
    assert (cos, sin) == pytest.approx((8 * np.cos(0.8), 8 * np.sin(0.8)), abs=1.0)
    before, after = (found.document[k]['holdout_rms_arcsec'] for k in ('before', 'after'))
    assert before > 3.0 and after < 1.4  # the noise is 0.99
    assert found.document['kept_out'] == 25
    assert found.model.provenance['last_stamp_ns'] == night.last_stamp
    assert night.zeros_in_force == found.zeros


def test_rows_kept_out_change_nothing_but_the_judgement():
    rows = block(70, 1, eccentric=8.0), block(8, 2, eccentric=8.0, polaris=True)
    good, wild = (block(25, 3, eccentric=size, check=1.0) for size in (8.0, 400.0))
    results = []
    for kept in (good, wild):
        night = session(*rows, kept)
        results.append((night.model, night.diagnose(site=SITE)))
    (fit_a, a), (fit_b, b) = results
    assert fit_a.terms == fit_b.terms
    assert a.model.to_json() == b.model.to_json()
    assert a.zeros == b.zeros
    texts = [json.loads(json.dumps(found.document)) for found in (a, b)]
    for text in texts:
        for key in ('before', 'after'):
            text[key].pop('holdout_rms_arcsec')
    assert texts[0] == texts[1]
    assert b.document['after']['holdout_rms_arcsec'] > 50.0
    # and a zero does not see them either
    assert is_kept_out(good).all() and len(for_fitting(good)) == 0


def test_nothing_significant_leaves_the_model_as_it_was():
    night = session(block(70, 1), block(8, 2, polaris=True))
    fitted, zeros = night.model, dict(night.zeros_in_force)
    found = night.diagnose(site=SITE)
    assert found.document['verdict'] == 'none' and found.document['effects'] == []
    assert found.model.terms == fitted.terms and found.model.effects == ()
    np.testing.assert_array_equal(found.model.covariance, fitted.covariance)
    assert found.zeros == zeros
    assert found.document['format'] == FORMAT
    assert found.document['alpha'] == 0.01
    assert found.document['site_deg'] == pytest.approx([34.3, 109.0])
    json.dumps(found.document, allow_nan=False)


@pytest.mark.parametrize('fit', [True, False])
def test_model_and_zero_of_each_power_on_belong_together(fit):
    night = session(
        block(45, 1, eccentric=8.0), block(8, 2, eccentric=8.0, polaris=True),
        block(8, 3, run=2, zero=DRIFT, eccentric=8.0, polaris=True),
        block(45, 4, run=2, zero=DRIFT, eccentric=8.0), fit=fit)
    found = night.diagnose()
    assert 'azimuth_encoder_1' in found.document['applied']
    change = found.zeros[2].angles - found.zeros[1].angles
    np.testing.assert_allclose(change / ARCSEC, DRIFT / ARCSEC, atol=1.0)
    for number, zero in ((1, np.zeros(2)), (2, DRIFT)):
        fresh = block(200, 7, run=number, zero=zero, eccentric=8.0)
        x, y = found.model.residuals(fresh, zero=found.zeros[number])
        assert np.sqrt(np.mean(x**2 + y**2)) / ARCSEC < 1.4  # the noise is 0.99
    told = {row['run']: row['az_arcsec'] * ARCSEC
            for row in found.model.provenance['zeros_in_force']}
    assert told == pytest.approx({n: z.az for n, z in found.zeros.items()})


def test_a_diagnosis_without_stars_is_refused_with_a_reason():
    with pytest.raises(ValueError, match='no observation has come yet'):
        CalibrationSession().diagnose()
    with pytest.raises(ValueError, match='no star to diagnose has come yet'):
        session(block(8, 2, polaris=True), fit=False).diagnose()
    with pytest.raises(ValueError, match='observe more or fit fewer'):
        session(block(4, 1), fit=False).diagnose()


def test_the_newest_of_many_nights_is_diagnosed():
    series = NightSeries(1)
    for run in (1, 2):
        for seed, polaris in ((1, False), (2, True)):
            rows = block(8 if polaris else 60, seed, run=run, polaris=polaris,
                         eccentric=8.0 if run == 2 else 0.0)
            series.add(rows, 10 * run + seed)
        series.calibrate_zero()
        series.fit()
    assert series.diagnose().document['applied'] == ['azimuth_encoder_1']


def test_a_reading_is_what_the_encoder_reads():
    from calibration.session_diagnosis import _at_zero
    rows = block(5, 1)
    rows.columns['miss_x'] = np.full(5, 9.0) * ARCSEC
    out = _at_zero(rows, Zeros([RunZero(7 * ARCSEC, 0.0, run=1)]), SITE)
    np.testing.assert_allclose(
        wrap(out['az_raw'] - rows['az_enc']) * np.cos(rows['el']) / ARCSEC, -9.0, atol=1e-6)
    np.testing.assert_allclose((out['az_enc'] - rows['az_enc']) / ARCSEC, -7.0, atol=1e-6)
    assert out.meta['site'] is SITE and out['star'].dtype.kind == 'i'


def test_a_drift_goes_on_for_as_long_again_as_was_observed():
    def drifting(rows):
        columns = dict(rows.columns)
        hours = (columns['time'] - start) / 3600.0
        columns['el_enc'] = columns['el_enc'] + 40.0 * hours * ARCSEC
        return PointingRun(columns)

    first = block(80, 1)
    start, length = first['time'][0], np.ptp(first['time'])
    found = session(drifting(first), fit=False).diagnose()
    assert found.document['applied'] == ['elevation_zero_with_time']
    later = block(100, 7)
    for shift, held in ((0.95, False), (3.0, True)):
        later.columns['time'] = np.full(100, start + length * (1.0 + shift))
        _, y = found.model.residuals(drifting(later))
        lag = 40.0 * length / 3600.0 * (shift - 1.0) if held else 0.0
        assert np.mean(y) / ARCSEC == pytest.approx(lag, abs=2.5)


def test_the_square_of_time_is_held_from_the_last_row_on():
    def bent(rows):
        columns = dict(rows.columns)
        u = (columns['time'] - start) / 1200.0
        columns['el_enc'] = columns['el_enc'] + 20.0 * u**2 * ARCSEC
        return PointingRun(columns)

    first = block(80, 1)
    start = first['time'][0] + 600.0
    found = session(bent(first), fit=False).diagnose()
    assert 'elevation_zero_with_time_squared' in found.document['applied']
    later = block(4, 7)
    x, y = [], []
    for seconds in (0.0, 4000.0):
        later.columns['time'] = np.full(4, first['time'][-1] + seconds)
        squared = [e for e in found.model.effects if e.effect.name.endswith('squared')]
        from pointing_model.fitted_effects import as_context, total
        dx, dy = total(squared, as_context(later, later['az'], later['el']))
        x.append(dx), y.append(dy)
    np.testing.assert_array_equal(y[0], y[1])


def test_the_noise_of_measured_rates_is_no_latency():
    from calibration.session_diagnosis import _at_zero
    from pointing_model.context import Context
    rows = block(50, 1)
    alone = Context(rows['az'], rows['el'], None, SITE['latitude'])
    rng = np.random.default_rng(3)
    for factor, there in ((1.0, False), (3.0, True)):
        measured = PointingRun({**rows.columns, **{
            name: factor * alone.get(name) + 0.3 * ARCSEC * rng.normal(size=50)
            for name in ('az_rate', 'el_rate')}})
        assert ('az_rate' in _at_zero(measured, Zeros(), SITE)) == there
        assert 'az_rate' in _at_zero(measured, Zeros(), None)  # without a site nothing is known
