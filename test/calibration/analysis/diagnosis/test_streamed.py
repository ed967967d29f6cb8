"""A run too long for the search in memory: the same command, the same kind of result."""

import json

import numpy as np
import pytest

from calibration.analysis.diagnosis import Base, diagnose, streamed
from calibration.report.diagnosis_page import render
from calibration.report.diagnosis_view import view_of
from calibration.report.effect_words import effects_told
from msg_tools.units import ARCSEC, DEG
from pointing_model import geometry
from pointing_model.runs.run import PointingRun
from pointing_model.terms import PHYSICAL

TRUTH = dict(zip(PHYSICAL, np.array([20.0, -35.0, 25.0, -18.0, 30.0, -22.0, 15.0]) * ARCSEC))


def night(seed, n=400, effect=None, noise=None, **terms):
    """Stars above 20 degrees; `effect(columns) -> (x, y)` in arcsec on the sky."""
    rng = np.random.default_rng(seed)
    az = rng.uniform(0.0, 2.0 * np.pi, n)
    el = np.arcsin(rng.uniform(np.sin(20.0 * DEG), np.sin(85.0 * DEG), n))
    az_enc, el_enc = geometry.sky_to_encoder(az, el, {**TRUTH, **terms})
    columns = {
        'az': az, 'el': el, 'time': 1.7e9 + 86400.0 * seed + np.cumsum(rng.uniform(30.0, 60.0, n)),
        'approach_az': np.sign(np.append(1.0, np.diff(az))),
        'approach_el': np.sign(np.append(1.0, np.diff(el))), 'magnitude': rng.uniform(1.0, 6.0, n)}
    e = rng.normal(size=(2, n)) if noise is None else noise(rng, el)
    x, y = (0.0, 0.0) if effect is None else effect(columns)
    columns['az_enc'] = az_enc + (x + e[0]) * ARCSEC / np.cos(el)
    columns['el_enc'] = el_enc + (y + e[1]) * ARCSEC
    return PointingRun(columns)


def two(c):
    return 0.7 * np.cos(2.0 * c['az']) * np.cos(c['el']), 0.6 * c['approach_el']


@pytest.fixture(scope='module')
def both():
    """The same 2000 rows in chunks and in memory."""
    run = PointingRun.concatenate([night(50 + i, effect=two) for i in range(5)])
    run.columns['az_enc'][7] += 900.0 * ARCSEC
    return (diagnose(run, streamed_from=1000, holdout=night(60, effect=two)),
            diagnose(run, cross_validation=False, flips=299))


def test_streamed_agrees_with_the_search_in_memory(both):
    result, other = both
    values = {e.fitted.effect.name: e.fitted.coefficients / ARCSEC for e in result.effects}
    assert set(values) == {'azimuth_encoder_2', 'elevation_hysteresis'}
    assert values['azimuth_encoder_2'] == pytest.approx([0.7, 0.0], abs=0.15)
    assert values['elevation_hysteresis'] == pytest.approx([0.6], abs=0.1)
    assert result.after['rms_arcsec'] == pytest.approx(2.0**0.5, rel=0.03)
    assert result.model.terms['AN'] == pytest.approx(TRUTH['AN'], abs=0.3 * ARCSEC)
    # the robust weights differ, nothing else
    for e in other.effects:
        assert values[e.fitted.effect.name] == pytest.approx(
            e.fitted.coefficients / ARCSEC, abs=0.02)
    for name, value in other.model.terms.items():
        assert result.model.terms[name] == pytest.approx(value, abs=0.05 * ARCSEC)
    ours, theirs = ({e.fitted.effect.name: (e.fitted.sigma / ARCSEC).tolist()
                     for e in r.effects} for r in both)
    for name, sigma in theirs.items():
        assert ours[name] == pytest.approx(sigma, rel=0.05)
    assert result.noise_floor_arcsec == pytest.approx(other.noise_floor_arcsec, rel=0.02)
    assert result.before['rms_arcsec'] == pytest.approx(other.before['rms_arcsec'], rel=0.01)
    (best, *_), (their_best, *_) = result.ranking, other.ranking
    assert best['name'] == their_best['name']
    assert best['delta_bic'] == pytest.approx(their_best['delta_bic'], rel=0.1)


def test_it_is_a_diagnosis_like_any_other(both):
    result, other = both
    one, two_ = result.to_dict(), other.to_dict()
    json.dumps(one)
    assert set(one) == set(two_) and one['observations'] == 2000
    assert set(one['effects'][0]) == set(two_['effects'][0])
    assert one['after']['cv_rms_arcsec'] is None and one['next_observations'] == []
    assert [e['row'] for e in one['excluded']] == [7]
    # only IA and IE are the held-out night's own; the noise is 1.41"
    assert 1.38 < one['after']['holdout_rms_arcsec'] < one['before']['holdout_rms_arcsec']
    (note,) = (n for n in result.notes if 'in chunks' in n)
    assert note.startswith('2000 rows are more than 1000') and 'did not cross-validate' in note
    page = render(view_of(result))
    assert all(told.sentence in page for told in effects_told(result))
    assert 'in chunks' in page and len(page) < 3_000_000
    assert np.allclose(result.model.residuals(result.observations.run), result.residual_after,
                       atol=1e-4 * ARCSEC)
    # every p is a share of 1999 draws
    assert min(r['p_family'] for r in result.ranking) >= 0.0005


def test_nothing_is_found_in_noise_that_grows_toward_the_horizon():
    run = PointingRun.concatenate([
        night(70 + i, noise=lambda rng, el: rng.normal(size=(2, len(el))) / np.sin(el))
        for i in range(3)])
    result = diagnose(run, streamed_from=1000)
    assert result.verdict == 'none' and result.effects == []
    assert result.before == result.after


def test_each_run_has_zeros_of_its_own(monkeypatch):
    some = [night(80 + i, n=240, effect=two, IA=(20.0 + 300.0 * i) * ARCSEC) for i in range(3)]
    result = diagnose(some, streamed_from=500)
    assert {e.fitted.effect.name for e in result.effects} >= {'azimuth_encoder_2',
                                                              'elevation_hysteresis'}
    zeros = [terms['IA'] for terms in result.run_terms.values()]
    assert np.diff(zeros) == pytest.approx([300.0] * 2, abs=1.0)
    assert not result.excluded and result.after['rms_arcsec'] < 1.5
    other = diagnose(some, cross_validation=False, flips=299)
    for run, terms in other.run_terms.items():
        assert terms == pytest.approx(result.run_terms[run], abs=0.15)
    monkeypatch.setattr(streamed, '_OWN', 5)
    with pytest.raises(ValueError, match='720 rows are too many to fit IA, IE in each of 3 runs'):
        diagnose(some, streamed_from=500)


def test_harmonics_and_aliases():
    def late(c):
        c['temperature'] = 20.0 - (c['time'] - c['time'][0]) / 1800.0
        return 0.0, 0.4 * (c['time'] - c['time'][0]) / 3600.0
    result = diagnose(night(90, n=1500, effect=late), Base.parse('physical+sh2'),
                      streamed_from=1000)
    (one,) = result.effects
    assert {one.fitted.effect.name, *one.aliases} >= {
        'elevation_zero_with_time', 'elevation_zero_with_temperature'}
    assert result.verdict == 'ambiguous' and set(one.aliases) <= set(one.alternatives)
    assert result.model.harmonics is not None
    assert 'AN' in dict(result.untestable)['latitude']
