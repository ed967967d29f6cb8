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

import json

import numpy as np
import pytest

from calibration.analysis.harmonic_fit import HarmonicChoice
from calibration.calibration_state import CalibrationState
from calibration.night_diagnosis import FORMAT
from calibration.night_series import NightSeries
from calibration.report.verdict_wording import verdict_sentences
from calibration.report.wording import paragraph
from calibration.rows import for_fitting, is_kept_out
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.model import PointingModel
from pointing_model.pointing_terms import PHYSICAL
from pointing_model.runs.run import PointingRun
from pointing_model.sky.star_catalogue import POLARIS_HIP
from pointing_model.zero import PowerOnZero, Zeros

MOUNT = PointingModel(dict(zip(PHYSICAL, np.array([310, -170, 46, -23, 37, -21, 15]) * ARCSEC)))
pytestmark = pytest.mark.usefixtures('nothing_expected')
DRIFT = np.array([20.0, -12.0]) * ARCSEC  # of the second power-on
START = 1_768_482_000.0
SITE = {'latitude': 34.3 * DEG, 'longitude': 109.0 * DEG}


def block(n, seed, *, run=1, zero=(0.0, 0.0), eccentric=0.0, check=0.0, polaris=False, order=1):
    """Stars (or Polaris) through `MOUNT`, whose azimuth disc lies off its axis (arcsec), or reads
    so much too much `order` times a turn.
    """
    rng = np.random.default_rng(seed)
    az, el = rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(0.35, 0.99, n))
    if polaris:
        az, el = 0.3 * DEG + 1e-4 * np.arange(n), 34.9 * DEG + 1e-5 * np.arange(n)
    az_enc, el_enc = MOUNT.sky_to_encoder(az, el)
    x, y = rng.normal(size=(2, n)) * 0.7 * ARCSEC
    return PointingRun({
        'time': START + 1e5 * run + 1e4 * seed + 15.0 * np.arange(n), 'az': az, 'el': el,
        'az_enc': az_enc + zero[0] + eccentric * ARCSEC * np.cos(order * az - 0.8) + x / np.cos(el),
        'el_enc': el_enc + zero[1] + y, 'run': np.full(n, float(run)),
        'star': np.full(n, float(POLARIS_HIP)) if polaris else 1000.0 * seed + np.arange(n),
        'check': np.full(n, check), 'miss_x': np.zeros(n), 'miss_y': np.zeros(n)})


def same_series(one, other):
    """Whether harmonics of two models predict the same."""
    return one.interpretation == other.interpretation and np.array_equal(
        [one.coef_x, one.coef_y], [other.coef_x, other.coef_y])


def session(*blocks, fit=True, **options):
    out = CalibrationState(**options)
    for number, rows in enumerate(blocks):
        out.add(rows, (number + 1) * 10**9)
    if fit:
        out.calibrate_zero()
        out.fit()
    return out


@pytest.fixture(autouse=True)
def often_short(request):
    """The nights of `eccentric` and `amended` are diagnosed in full. Rows kept out, or left out by
    turns, judge all the same.
    """
    if not {'eccentric', 'amended'} & set(request.fixturenames):
        request.getfixturevalue('short_diagnosis')


@pytest.fixture(scope='module')
def eccentric():
    """A night with a disc off its axis and blind stars: its model before, itself, its diagnosis."""
    night = session(block(70, 1, eccentric=8.0), block(8, 2, eccentric=8.0, polaris=True),
                    block(25, 3, eccentric=8.0, check=1.0))
    fitted = night.model
    return fitted, night, night.diagnose(site=SITE)


def test_the_effect_is_added_and_stars_that_nothing_has_seen_gain(eccentric):
    _, night, found = eccentric
    assert found.document['verdict'] == 'identified'
    assert found.document['applied'] == ['azimuth_encoder_1']
    cos, sin = (found.model.effects[0].coefficients / ARCSEC)
    assert (cos, sin) == pytest.approx((8 * np.cos(0.8), 8 * np.sin(0.8)), abs=1.0)
    before, after = (found.document[k]['holdout_rms_arcsec'] for k in ('before', 'after'))
    assert before > 3.0 and after < 1.4  # the noise is 0.99
    assert found.document['kept_out'] == 25
    assert found.model.provenance['last_stamp_ns'] == night.last_stamp
    assert night.active_zeros == found.chosen.zeros


def test_rows_kept_out_change_nothing_but_the_judgement(eccentric):
    fit_a, _, a = eccentric
    good, wild = (block(25, 3, eccentric=size, check=1.0) for size in (8.0, 400.0))
    night = session(block(70, 1, eccentric=8.0), block(8, 2, eccentric=8.0, polaris=True), wild)
    fit_b, b = night.model, night.diagnose(site=SITE)
    assert fit_a.terms == fit_b.terms
    assert a.model.to_json() == b.model.to_json()
    assert a.chosen.zeros == b.chosen.zeros
    texts = [json.loads(json.dumps(found.document)) for found in (a, b)]
    for text in texts:
        for key in ('before', 'after'):
            text[key].pop('holdout_rms_arcsec')
        assert text.pop('judgement')['rows'] == 25
    assert texts[0] == texts[1]
    assert b.document['after']['holdout_rms_arcsec'] > 50.0
    # and a zero does not see them either
    assert is_kept_out(good).all() and len(for_fitting(good)) == 0


def test_nothing_significant_leaves_the_model_as_it_was():
    night = session(block(70, 1), block(8, 2, polaris=True))
    fitted, zeros = night.model, dict(night.active_zeros)
    found = night.diagnose(site=SITE)
    assert found.document['verdict'] == 'none' and found.document['effects'] == []
    assert found.model.terms == fitted.terms and found.model.effects == ()
    np.testing.assert_array_equal(found.model.covariance, fitted.covariance)
    assert found.chosen.zeros == zeros
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
    change = found.chosen.zeros[2].angles - found.chosen.zeros[1].angles
    np.testing.assert_allclose(change / ARCSEC, DRIFT / ARCSEC, atol=1.0)
    for number, zero in ((1, np.zeros(2)), (2, DRIFT)):
        fresh = block(200, 7, run=number, zero=zero, eccentric=8.0)
        x, y = found.model.residuals(fresh, zero=found.chosen.zeros[number])
        assert np.sqrt(np.mean(x**2 + y**2)) / ARCSEC < 1.4  # the noise is 0.99
    told = {row['run']: row['az_arcsec'] * ARCSEC
            for row in found.model.provenance['zeros_in_force']}
    assert told == pytest.approx({n: z.az for n, z in found.chosen.zeros.items()})


def test_a_diagnosis_without_stars_is_refused_with_a_reason():
    with pytest.raises(ValueError, match='no observation has come yet'):
        CalibrationState().diagnose()
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
    from calibration.rows import without_zeros
    rows = block(5, 1)
    rows.columns['miss_x'] = np.full(5, 9.0) * ARCSEC
    out = without_zeros(rows, Zeros([PowerOnZero(7 * ARCSEC, 0.0, run=1)]), SITE)
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


def climbing(rows, start, arcsec, length):
    """The elevation zero climbs by so much in `length` seconds from `start` on, then rests."""
    u = np.clip((rows['time'] - start) / length, 0.0, 1.0)
    return PointingRun({**rows.columns, 'el_enc': rows['el_enc'] + arcsec * u * ARCSEC})


def after(rows, *blocks):
    """The blocks, each a minute after the one before it."""
    out = [rows]
    for part in blocks:
        begin = out[-1]['time'][-1] + 60.0
        out.append(PointingRun({**part.columns, 'time': begin + 15.0 * np.arange(len(part))}))
    return out


def test_what_does_not_hold_on_rows_kept_out_is_not_published():
    # it climbs, and when the night's stars are done it is back where it began
    stars, kept = after(block(80, 1), block(25, 3, check=1.0))
    start, length = stars['time'][0], np.ptp(stars['time'])
    night = session(block(8, 2, polaris=True), climbing(stars, start, 8.0, length), kept)
    fitted, zeros = night.model, dict(night.active_zeros)
    found = night.diagnose(site=SITE)
    document = found.document
    assert document['verdict'] == 'withheld' and not document['published']
    assert document['effects'] == document['applied'] == []
    entry, = document['refused']
    assert 'elevation_zero_with_time' in entry['effects']
    assert entry['found'][0]['name'] == 'elevation_zero_with_time'
    assert 'in elevation' in entry['why'] and '25 new rows' in entry['why']
    assert entry['judgement']['radial']['chance'] < 0.05
    assert any(note.startswith('not published: elev') for note in document['notes'])
    assert found.model.terms == fitted.terms and found.chosen.zeros == zeros
    assert found.model.effects == ()
    assert document['after'] == document['before']
    assert found.diagnosis.verdict == 'withheld'
    assert 'Not published' in paragraph(found.diagnosis.cautions)
    headline, sentences = verdict_sentences(found.diagnosis.to_dict(),
                                            caution=paragraph(found.diagnosis.cautions))
    assert 'stays active' in headline and any('Not published' in text for text in sentences)
    json.dumps(document, allow_nan=False)
    # and there is nothing to take back
    told = night.check_on_blind_stars()
    assert told.document['judged']['taken_back'] is False
    assert told.model.terms == fitted.terms and told.document['verdict'] == 'withheld'


def test_an_axis_that_is_made_worse_does_not_cost_the_other_its_gain():
    stars, kept = after(block(90, 1, eccentric=8.0), block(30, 3, eccentric=8.0, check=1.0))
    start, length = stars['time'][0], np.ptp(stars['time'])
    night = session(block(8, 2, polaris=True, eccentric=8.0),
                    climbing(stars, start, 8.0, length), kept)
    found = night.diagnose(site=SITE)
    assert found.document['published'] and found.document['verdict'] == 'identified'
    assert found.document['applied'] == ['azimuth_encoder_1']
    assert [e['name'] for e in found.document['effects']] == ['azimuth_encoder_1']
    assert found.document['refused'][0]['effects'] == ['elevation_zero_with_time']
    before, now = (found.document[k]['holdout_rms_arcsec'] for k in ('before', 'after'))
    assert now < 0.85 * before  # what is left is the zero that climbed
    cos, sin = (found.model.effects[0].coefficients / ARCSEC)
    assert (cos, sin) == pytest.approx((8 * np.cos(0.8), 8 * np.sin(0.8)), abs=1.0)


def test_without_rows_kept_out_fit_and_search_are_repeated_without_some():
    stars, = after(block(90, 1, eccentric=8.0))
    found = session(block(8, 2, polaris=True, eccentric=8.0), stars).diagnose(site=SITE)
    assert found.document['applied'] == ['azimuth_encoder_1'] and found.document['published']
    assert found.document['judgement']['rows'] == 22
    assert found.document['judgement']['radial']['chance'] > 0.9
    # of few rows none can be spared, and it is said
    few = session(block(24, 1, eccentric=12.0), fit=False).diagnose(site=SITE)
    if few.document['applied']:
        assert any('not judged before it was published' in n for n in few.document['notes'])


def test_blind_stars_take_back_a_model_that_is_worse():
    stars, first, later = after(block(80, 1), block(15, 3, check=1.0), block(25, 4, check=1.0))
    start, length = stars['time'][0], np.ptp(stars['time'])
    # it goes on climbing while the first judges look, and is back when the next do
    held = climbing(first, start, 9.0, length)
    night = session(block(8, 2, polaris=True), climbing(stars, start, 9.0, length), held)
    fitted, zeros = night.model, dict(night.active_zeros)
    published = night.diagnose(site=SITE)
    assert published.document['published']
    assert 'elevation_zero_with_time' in published.document['applied']
    few = night.check_on_blind_stars(site=SITE)
    assert few.document['judged']['why'].startswith('not judged: 0 blind stars')
    assert few.model.effects == published.model.effects
    night.add(later, 9 * 10**9)
    taken = night.check_on_blind_stars(site=SITE)
    judged = taken.document['judged']
    assert judged['taken_back'] and judged['rows'] == 25
    assert judged['why'].startswith('taken back: 25 new rows')
    assert judged['radial']['after_arcsec'] > 1.5 * judged['radial']['before_arcsec']
    assert taken.document['verdict'] == 'taken_back' and taken.document['applied'] == []
    assert taken.diagnosis.verdict == 'taken_back' and [judged['why']] == taken.diagnosis.cautions
    assert taken.model.terms == fitted.terms and taken.model.effects == ()
    assert dict(night.active_zeros) == zeros and night.report['verdict'] == 'taken_back'
    assert taken.model.provenance['last_stamp_ns'] == 9 * 10**9
    assert taken.model.provenance['judged'] == 'taken back'
    # once more: the one before is in force
    assert night.check_on_blind_stars(site=SITE).document['judged']['taken_back'] is False


@pytest.fixture(scope='module')
def amended():
    """Rows of a night, a session with all but the last of them for one test, its diagnosis."""
    stars, first, later = after(block(70, 1, eccentric=8.0), block(15, 3, eccentric=8.0, check=1.),
                                block(20, 4, eccentric=8.0, check=1.0))
    rows = stars, block(8, 2, eccentric=8.0, polaris=True), first, later
    night = session(*rows[:3])
    return rows, night, night.diagnose(site=SITE)


def test_blind_stars_leave_a_good_model_in_force(amended):
    (stars, *_, later), night, amended = amended
    night.add(later, 9 * 10**9)
    held = night.check_on_blind_stars(site=SITE)
    assert held.document['judged']['why'].startswith('holds: 20 new rows')
    assert held.model.effects == amended.model.effects
    assert held.model.terms == amended.model.terms
    assert held.document['verdict'] == 'identified'
    with pytest.raises(ValueError, match='diagnose first'):
        session(stars, fit=False).check_on_blind_stars()


def test_a_diagnosis_as_of_then_knows_no_later_rows(amended):
    rows, _, then = amended
    night = session(*rows)
    again = night.diagnose(site=SITE, until=3 * 10**9)
    assert then.document == again.document
    assert then.model.terms == again.model.terms
    assert night.check_on_blind_stars(site=SITE).document['judged']['rows'] == 20


def test_a_fit_that_is_worse_does_not_replace_the_model_in_force():
    stars, kept, more, last = after(block(60, 1), block(20, 3, check=1.0), block(30, 4),
                                    block(20, 5, check=1.0))
    night = session(block(8, 2, polaris=True), stars, kept, fit=False)
    in_force = night.fit()[0].to_json()
    good, zeros = night.model, dict(night.active_zeros)
    # somebody bumps the encoder while 30 more are observed, and it comes back
    bumped = PointingRun({**more.columns, 'el_enc': more['el_enc'] + 9.0 * ARCSEC})
    night.add(bumped, 8 * 10**9)
    night.add(last, 9 * 10**9)
    model, report = night.fit()
    assert model.terms == good.terms and dict(night.active_zeros) == zeros
    assert model.provenance['last_stamp_ns'] == 9 * 10**9
    assert report['refused'].startswith('this fit is not published: 40 new rows')
    assert report['refused'] in report['notes']
    # a calibration that was started again knows what is in force, and judges as this one did
    again = session(block(8, 2, polaris=True), stars, kept, bumped, last, fit=False)
    assert again.fit()[1].get('refused') is None
    again = session(block(8, 2, polaris=True), stars, kept, bumped, last, fit=False)
    again.take_up(PointingModel.from_json(in_force))
    taken, told = again.fit()
    assert told['refused'] == report['refused'] and taken.terms == model.terms
    assert dict(again.active_zeros) == zeros
    # with good rows it does
    night = session(block(8, 2, polaris=True), stars, kept)
    night.add(more, 8 * 10**9)
    model, report = night.fit()
    assert 'refused' not in report and model.terms != good.terms


def test_the_noise_of_measured_rates_is_no_latency():
    from pointing_model.context import Context
    rows = block(50, 1)
    alone = Context(rows['az'], rows['el'], None, SITE['latitude'])
    rng = np.random.default_rng(3)
    # read alone, of an axis that slips by 10" within the second, of a satellite
    for factor, noise, own in ((1.0, 0.3, False), (1.0, 5.0, False), (3.0, 0.3, True)):
        measured = {name: factor * alone.get(name) + noise * ARCSEC * rng.normal(size=50)
                    for name in ('az_rate', 'el_rate')}
        run = PointingRun({**rows.columns, **measured}, {'site': SITE})
        rate = Context.from_run(run).get('az_rate')
        assert np.array_equal(rate, measured['az_rate'] if own else alone.get('az_rate'))
        # without a site nothing is known
        assert 'az_rate' in Context.from_run(PointingRun(run.columns, {})).columns


@pytest.mark.parametrize('reading', ['zenith', 'printed'])
def test_an_effect_is_found_on_top_of_terms_and_harmonics(reading):
    twice = {'eccentric': 8.0, 'order': 2}  # which no harmonic of order 1 holds
    night = session(block(90, 1, **twice), block(8, 2, polaris=True, **twice),
                    block(25, 3, check=1.0, **twice), harmonics=HarmonicChoice(reading, False, 2))
    fitted = night.model
    found = night.diagnose(site=SITE)
    assert found.document['published']
    # the base is that of the model in force, and its harmonics are fitted again with the effect
    assert found.diagnosis.base.names()[-1] == ('sh2' if reading == 'zenith' else 'sh2p')
    series = found.model.harmonics
    assert (series.interpretation, series.degree) == (reading, 2)
    assert not same_series(series, fitted.harmonics)
    assert found.model.effects and list(found.model.terms) == list(fitted.terms)
    before, after = (found.document[k]['holdout_rms_arcsec'] for k in ('before', 'after'))
    assert before > 1.2 * after and after < 1.5  # the noise is 0.99
    assert PointingModel.from_json(found.model.to_json()).to_json() == found.model.to_json()


def test_what_the_harmonics_hold_is_no_effect():
    """A disc off its axis is A2 and A3, for which the terms have no name."""
    rows = block(90, 1, eccentric=8.0), block(8, 2, eccentric=8.0, polaris=True)
    plain, series = (session(*rows, harmonics=choice).diagnose(site=SITE) for choice in (
        HarmonicChoice(), HarmonicChoice('zenith', False, 1)))
    assert plain.document['applied'] == ['azimuth_encoder_1']
    assert series.document['applied'] == []
    a2, a3 = (series.model.harmonics.coefficients[name][0] / ARCSEC for name in ('A2', 'A3'))
    assert (a2, a3) == pytest.approx((8 * np.cos(0.8), 8 * np.sin(0.8)), abs=1.5)


def test_nothing_found_leaves_terms_and_harmonics_as_they_were():
    night = session(block(90, 1), block(8, 2, polaris=True),
                    harmonics=HarmonicChoice('zenith', False, 1))
    found = night.diagnose(site=SITE)
    assert found.model.effects == () and not found.document['published']
    assert same_series(found.model.harmonics, night.model.harmonics)
    assert found.model.terms == night.model.terms
    # a fit again is the same model: nothing is there that could be taken back
    night.fit()
    assert same_series(night.diagnose(site=SITE).model.harmonics, found.model.harmonics)


def test_to_harmonics_alone_the_tilt_of_the_axis_lacks():
    night = session(block(90, 1), block(8, 2, polaris=True), block(25, 3, check=1.0),
                    harmonics=HarmonicChoice('zenith', True, 2))
    found = night.diagnose(site=SITE)
    assert found.document['published']
    assert found.model.harmonics.degree == 2 and found.model.effects
    before, after = (found.document[k]['holdout_rms_arcsec'] for k in ('before', 'after'))
    assert before > 2.0 * after and after < 1.6
    blind = block(20, 7, check=1.0)
    night.add(blind, 10**11)
    judged = night.check_on_blind_stars(SITE)
    assert not judged.document['judged']['taken_back']
    assert same_series(judged.model.harmonics, found.model.harmonics)
