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

import numpy as np
import pytest

from calibration.analysis.term_fit import fit_terms
from calibration.analysis.tracking.history import past_of_runs, rates_of_nights, rows_of
from calibration.analysis.tracking.innovations import Measurement
from calibration.analysis.tracking.motion_causes import TrackingSettings
from calibration.analysis.tracking.smoother import smooth
from calibration.analysis.tracking.tracker import Tracker, model_of_fit
from calibration.analysis.tracking.warm_start import (
    AS_IT_WAS,
    LEAN,
    REFIT,
    ZEROS,
    begin,
)
from msg_tools.units import ARCSEC, DEG
from pointing_model.model import PointingModel
from pointing_model.mounts import ALTAZ
from pointing_model.pointing_terms import design
from pointing_model.runs.run import PointingRun
from telescope_mount.observing.tracking_star import SlewTime, error_over, next_star, until
from test.calibration.analysis.tracking.test_tracker import known

MINUTE = 60_000_000_000
NAMES = ('IA', 'IE', 'CA', 'AN', 'AW', 'TF')
SIGMA = np.array([30.0, 30.0, 4.0, 8.0, 8.0, 4.0]) * ARCSEC
#: few hypotheses: fast
SETTINGS = TrackingSettings(zeros=(1.0 * ARCSEC, 3.0 * ARCSEC, 9.0 * ARCSEC), tilts=(0.5 * ARCSEC,))
MODEL = PointingModel(dict.fromkeys(NAMES, 0.0), np.eye(6) * (0.3 * ARCSEC) ** 2)


def sky(rng, n):
    return rng.uniform(0.0, 2.0 * np.pi, n), rng.uniform(25 * DEG, 75 * DEG, n)


def columns(az, el):
    return np.stack(design(NAMES, az, el), axis=1)


def run(rng, terms, n=25, noise=1.0):
    """Rows ten minutes apart; terms, shape (k,) or (n, k), rad."""
    az, el = sky(rng, n)
    terms = np.broadcast_to(terms, (n, len(NAMES)))
    x, y = (np.einsum('nij,nj->ni', columns(az, el), terms)
            + rng.normal(size=(n, 2)) * noise * ARCSEC).T
    sigma = np.full(n, noise * ARCSEC)
    return PointingRun({'time': 600.0 * np.arange(1, n + 1), 'az': az, 'el': el,
                        'az_enc': az + x / np.cos(el), 'el_enc': el + y,
                        'sigma_x': sigma, 'sigma_y': sigma})


@pytest.fixture(scope='module')
def past():
    """Twelve runs, of terms that scatter; one has a wrong star."""
    rng = np.random.default_rng(1)
    true = 100.0 * ARCSEC + rng.normal(size=(12, 6)) * SIGMA
    runs = [run(rng, terms) for terms in true]
    runs[3].columns['el_enc'][5] += 400.0 * ARCSEC
    return past_of_runs(runs, NAMES), true, runs


def test_the_past_is_the_mean_and_the_scatter_of_the_runs(past):
    found, true, _ = past
    np.testing.assert_allclose(found.noise, ARCSEC, rtol=0.15)
    np.testing.assert_allclose(found.mean, true.mean(axis=0), atol=1.5 * ARCSEC)
    ratio = np.sqrt(np.diag(found.covariance)) / true.std(axis=0)
    assert (ratio > 0.7).all() and (ratio < 1.5).all()
    assert np.abs(found.last - true[-1]).max() < 2.0 * ARCSEC
    recent = past_of_runs([rows_of(r, NAMES) for r in past[2]], NAMES, memory=2.0)
    distance = [np.abs(p.mean - true[-3:].mean(axis=0)).sum() for p in (recent, found)]
    assert distance[0] < distance[1]
    with pytest.raises(ValueError, match='no earlier run'):
        past_of_runs([], NAMES)


@pytest.mark.parametrize('story, moved', [
    (AS_IT_WAS, {}), (ZEROS, {'IA': 40.0, 'IE': -25.0}),
    (LEAN, {'IA': 40.0, 'IE': 30.0, 'AN': 15.0, 'AW': -18.0}),
    (REFIT, None)])
def test_five_stars_say_what_has_happened_even_with_a_wrong_one(past, story, moved):
    found, rng = past[0], np.random.default_rng(7)
    if moved is None:  # as another run may be
        true = found.mean - 1.2 * np.sqrt(np.diag(found.covariance)) * np.sign(
            found.last - found.mean)
    else:
        true = found.last + np.array([moved.get(name, 0.0) for name in NAMES]) * ARCSEC
    chosen = columns(np.array([0.3, 1.6, 2.8, 4.1, 5.4]), np.array([0.5, 1.2, 0.8, 1.3, 0.6]))
    off = chosen @ true + rng.normal(size=(5, 2)) * 0.7 * ARCSEC
    for bad in (0.0, 500.0):
        off[4] += bad * ARCSEC
        begun = begin(found, chosen, off)
        assert begun.likeliest == story or bad and story == REFIT
        error = np.abs(np.array(list(begun.terms.values())) - true)
        if not bad:
            assert (error < 4.0 * np.sqrt(np.diag(begun.covariance)) + 0.2 * ARCSEC).all()


def test_what_a_fit_did_not_determine_is_unknown_to_begin_with():
    rng = np.random.default_rng(2)
    rows = run(rng, 20.0 * ARCSEC, n=20)
    rows.columns['el'][:] = 0.7  # IA and CA are one there, IE and TF too
    rows.columns['el_enc'] = 0.7 + rng.normal(size=20) * ARCSEC
    rows.columns['az_enc'] = rows['az'] + rng.normal(size=20) * ARCSEC
    fit = fit_terms(rows, NAMES)
    assert len(fit.dropped) == 2
    sure, unsure = (Tracker(m, 0).expected([1.0, 1.0], [0.7, 1.3]).radial / ARCSEC
                    for m in (fit.model, model_of_fit(fit)))
    assert unsure[0] < 5.0 and unsure[1] > 20.0 > sure[1]


def wandering(rng, rate, n=40, jump=None):
    """A night of zeros that walk by `rate` arcsec in the root of an hour: run and terms."""
    steps = np.zeros((n, 6))
    steps[:, :2] = rng.normal(size=(n, 2)) * rate * np.sqrt(1.0 / 6.0) * ARCSEC
    if jump is not None:
        steps[jump, 0] += 40.0 * ARCSEC
    terms = np.cumsum(steps, axis=0)
    return run(rng, terms, n), terms


def test_nights_tell_how_fast_their_zeros_wander():
    rng = np.random.default_rng(5)
    rates = rates_of_nights([(MODEL, wandering(rng, 3.0)[0]) for _ in range(4)],
                            settings=SETTINGS)
    likeliest = rates.facts[np.argmax(rates.weights)]
    assert likeliest['zero'] == 3.0 * ARCSEC and rates.weights.sum() == pytest.approx(1.0)
    assert max(rates.weights) > 0.6
    tracker = Tracker(MODEL, 0, settings=SETTINGS, rate_weights=rates.weights)
    assert 2.5 < tracker.rates()['zero'] / ARCSEC < 6.0
    with pytest.raises(ValueError, match='no earlier night'):
        rates_of_nights([])
    bare = run(rng, 0.0)
    del bare.columns['sigma_x'], bare.columns['sigma_y']
    with pytest.raises(ValueError, match='noise'):
        rates_of_nights([(MODEL, bare)])
    assert rates_of_nights([(MODEL, bare)], settings=SETTINGS, noise=ARCSEC).weights[0] > 0.1


def test_hindsight_is_nearer_than_the_live_model_and_knows_the_jump():
    rng = np.random.default_rng(6)
    rows, true = wandering(rng, 3.0, jump=20)
    x, y = rows.offsets()
    x[10] += 150.0 * ARCSEC
    night = [Measurement('star', int(t * 1e9), (a, e, u, v, ARCSEC)) for t, a, e, u, v in zip(
        rows['time'], rows['az'], rows['el'], x, y)]
    tracker = Tracker(MODEL, 0, settings=SETTINGS, sensors=['difference'])
    # the incremental encoder does all of it
    night = [one for k, star in enumerate(night) for one in (
        Measurement('difference', star.stamp, (0, -true[k, 0] + 9.0, 0.3 * ARCSEC)), star)]
    night.insert(7, Measurement('star', 5, (1.0, 1.0, 0.0, 0.0, ARCSEC)))  # late: not taken
    before = known(tracker)
    back = smooth(tracker, night)
    assert known(tracker) == before
    assert [(e['star'], e['what']) for e in back.events] == [
        (10, 'wrong star'), (20, 'incremental encoder, azimuth')]
    live = []
    for one in night:
        if tracker.update(one).taken and one.what == 'star':
            live.append(list(tracker.terms()[0].values()))
    assert back.terms.shape == true.shape == np.shape(live)
    both = [np.sqrt(np.mean((terms - true)[:, 1] ** 2)) for terms in (back.terms, live)]
    assert both[0] < 0.9 * both[1]
    assert np.mean(((back.terms - true) / back.sigma)[:, :2] ** 2) < 2.0
    assert back.document()['terms']['IA']['sigma_arcsec'][5] < 1.5


def test_after_a_power_on_and_a_gap_hindsight_joins_nothing():
    rng = np.random.default_rng(8)
    rows, _ = wandering(rng, 1.0, n=30)
    x, y = rows.offsets()
    late = np.arange(30) >= 15
    x = x + np.where(late, 90.0 * ARCSEC, 0.0) * np.cos(rows['el'])
    y = y + np.where(late, 25.0 * ARCSEC, 0.0)
    night = [Measurement('star', int((t + 8 * 3600 * o) * 1e9), (a, e, u, v, ARCSEC))
             for t, a, e, u, v, o in zip(rows['time'], rows['az'], rows['el'], x, y, late)]
    night.insert(15, Measurement('power_on', night[14].stamp + MINUTE, ((0,), 100.0 * ARCSEC)))
    back = smooth(Tracker(MODEL, 0, settings=SETTINGS), night)
    zeros = back.terms[:, :2] / ARCSEC
    assert back.events == []
    np.testing.assert_allclose(zeros[15] - zeros[14], [90.0, 25.0], atol=3.0)


def test_the_next_star_is_worth_its_time():
    tracker, rng = Tracker(MODEL, 0, settings=SETTINGS), np.random.default_rng(9)
    az, el = sky(rng, 100)
    places, here = sky(rng, 40), (1.0, 0.8)
    update = tracker.star(MINUTE, 1.0, 0.8, 0.0, 0.0, ARCSEC)
    assert update.taken
    left = until(tracker, places, 2.0 * ARCSEC)
    assert 60.0 < left < 7200.0
    assert error_over(tracker, places, left) == pytest.approx(2.0 * ARCSEC, rel=0.01)
    assert until(tracker, places, 0.1 * ARCSEC) == 0.0
    assert until(tracker, places, 1.0) == 7200.0
    near = np.hypot(np.cos(el) * np.sin((az - 1.0) / 2.0) * 2.0, el - 0.8) < 0.5
    free = next_star(tracker, az, el, here, places, sigma=ARCSEC)
    assert near[free.row] and free.after < free.before and 13.0 < free.seconds < 60.0
    assert free.sentence().startswith(f'{free.seconds:.0f} s: reduces the expected error from')
    slow = next_star(tracker, az, el, here, places, sigma=ARCSEC, exposure_s=300.0)
    assert slow.seconds - 300.0 > free.seconds - 10.0  # the way is a small part of the time
    other = next_star(tracker, az, el, here, places, sigma=ARCSEC, allowed=~near)
    assert not near[other.row]
    with pytest.raises(ValueError, match='no star'):
        next_star(tracker, az, el, here, places, sigma=ARCSEC, allowed=np.zeros(100, bool))


def test_slews_take_the_longer_of_two_axes():
    slew = SlewTime(rates=(2 * DEG, 1 * DEG), acceleration=1 * DEG, settle_s=3.0)
    seconds = slew.seconds(ALTAZ, (350 * DEG, 40 * DEG), (
        np.array([350.0, 20.0, 351.0, 350.0]) * DEG, np.array([40.0, 40.0, 40.0, 60.0]) * DEG))
    np.testing.assert_allclose(seconds, [3.0, 3.0 + 15.0 + 2.0, 3.0 + 2.0, 3.0 + 20.0 + 1.0])
