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

"""A tracked night that begins with a model of the nights before."""

import json

import numpy as np
import pytest

from calibration.analysis.season.season_analysis import analyse_season
from calibration.analysis.season.season_nights import nights_of
from calibration.analysis.term_fit import fit_terms
from calibration.analysis.tracking.history import PAST, RATES, rate_weights_of
from calibration.analysis.tracking.tracked_night import TrackedNight
from calibration.analysis.tracking.tracker import Tracker
from calibration.analysis.tracking.warm_start import AS_IT_WAS, LEAN, ZEROS
from calibration.calibration_state import CalibrationState
from calibration.report.wording import worded
from msg_tools.units import ARCSEC
from pointing_model.model import PointingModel
from pointing_model.pointing_terms import PHYSICAL
from pointing_model.rms import rms
from pointing_model.runs.run import PointingRun
from pointing_model.zero import PowerOnZero

DAY, START = 86400.0, 1_768_482_000.0
TERMS = dict(zip(PHYSICAL, np.array([310.0, -170, 46, -23, 37, -21, 15]) * ARCSEC))


def night(number, off, seed, n=30, drift=2.0, noise=1.0):
    """Rows every six minutes of a mount whose terms are off by `off`, arcsec; zeros drift."""
    rng = np.random.default_rng([seed, number])
    model = PointingModel({name: value + off.get(name, 0.0) * ARCSEC
                           for name, value in TERMS.items()})
    az, el = rng.uniform(0.0, 2.0 * np.pi, n), rng.uniform(0.5, 1.3, n)
    enc = np.array(model.sky_to_encoder(az, el))
    walk = rng.normal(0.0, drift * np.sqrt(0.1), (2, n)).cumsum(axis=1)
    enc += ARCSEC * (walk + noise * rng.standard_normal((2, n)) / [np.cos(el), np.ones(n)])
    return PointingRun({
        'time': START + number * DAY + 360.0 * np.arange(n), 'run': np.full(n, float(number)),
        'star': 1.0 + np.arange(n), 'az': az, 'el': el, 'az_enc': enc[0], 'el_enc': enc[1],
        'encoder_start': np.full(n, START + number * DAY - 60.0),
        'miss_x': ARCSEC * rng.standard_normal(n), 'miss_y': ARCSEC * rng.standard_normal(n)},
        {'source': f'night {number}'})


@pytest.fixture(scope='module')
def foretold():
    """The model of ten nights, each with zeros of its own."""
    rng = np.random.default_rng(5)
    runs = [night(k, dict(zip(('IA', 'IE'), rng.normal(0.0, 30.0, 2))), 1) for k in range(10)]
    return analyse_season(nights_of(runs)).model()


def tracked(model, rows):
    state = CalibrationState(model, mode='track')
    for i in range(len(rows)):
        one = rows.select([i])
        state.add(one, int(np.rint(one['time'][0] * 1e9)))
    return state


@pytest.mark.parametrize('off, story', [
    ({'IA': 60.0, 'IE': -40.0}, ZEROS), ({'IA': 60.0, 'IE': -40.0, 'AN': 25.0, 'AW': 18.0}, LEAN)])
def test_the_first_stars_say_what_has_happened_and_beat_a_fit_of_them(foretold, off, story):
    rows = night(10, off, 2, n=60, drift=0.3)
    first = np.array([3, 12, 20, 33, 50])
    rest = np.setdiff1d(np.arange(60), first)
    state = tracked(foretold, rows.select(first))
    told = worded(state.tracked.document())
    chances = told['opening']['chances']
    assert max(chances, key=chances.get) == story and chances[story] > 0.6
    event, = told['events']
    assert told['stars'] == 5 and event['text'].startswith(f'since the last night: {story} (')
    model, _ = state.tracked.pair(state.last_stamp)
    held = rows.select(rest)

    def left(one):
        base = one.offsets(held['az'], held['el'])
        return rms(*(o - b for o, b in zip(held.offsets(), base))) / ARCSEC
    fresh = fit_terms(rows.select(first), tuple(PHYSICAL[:6])).model
    assert left(model) < left(fresh) and left(model) < 2.2  # noise alone: 1.5
    expected = told['expected_arcsec']['now']
    assert left(model)**2 - 1.6**2 < (3.0 * expected)**2


def test_nothing_moved_is_a_good_answer_too(foretold):
    last = json.loads(foretold.to_json())['provenance'][PAST]['last']
    off = {name: value / ARCSEC - TERMS[name] / ARCSEC for name, value in zip(PHYSICAL, last)}
    state = tracked(foretold, night(10, off, 3, drift=0.2).select(np.arange(0, 30, 6)))
    chances = worded(state.tracked.document())['opening']['chances']
    assert max(chances, key=chances.get) == AS_IT_WAS


def test_it_goes_on_to_the_bit_and_tells_of_the_nights_before_no_more(foretold):
    rows = night(10, {'IA': 50.0}, 4)
    for count in (3, 9):
        state = tracked(foretold, rows.select(np.arange(count)))
        model, _ = state.tracked.pair(state.last_stamp)
        assert PAST not in model.provenance and model.provenance[RATES]
        again = TrackedNight.from_model(PointingModel.from_json(model.to_json()))
        again.take(rows.select(np.arange(count)))
        assert again.model(state.last_stamp).to_json() == model.to_json()


def test_an_encoder_switched_on_among_the_first_stars_is_told_of(foretold):
    one, two = night(10, {'IA': 50.0}, 6), night(11, {'IA': -400.0, 'IE': 200.0}, 6)
    two = PointingRun(two.columns | {'time': one['time']}, two.meta)
    state = tracked(foretold, PointingRun.concatenate(
        [one.select(np.arange(3)), two.select(np.arange(3, 12))]))
    terms = state.tracked.model(0).terms
    assert terms['IA'] / ARCSEC == pytest.approx(-90.0, abs=6.0)
    assert terms['IE'] / ARCSEC == pytest.approx(30.0, abs=6.0)


def test_the_first_stars_count_by_their_own_sigmas(foretold):
    first = night(10, {'IA': 50.0}, 7).select(np.arange(5))
    first.columns['az_enc'][2] += 40.0 * ARCSEC / np.cos(first['el'][2])
    off = []
    for sigma in (1.0, 60.0):
        both = np.where(np.arange(5) == 2, sigma, 1.0) * ARCSEC
        state = tracked(foretold, PointingRun(
            first.columns | {'sigma_x': both, 'sigma_y': both}, first.meta))
        off.append(abs(state.tracked.model(0).terms['IA'] / ARCSEC - 50.0
                       - foretold.terms['IA'] / ARCSEC))
    assert off[1] < off[0]


def test_the_track_of_a_whole_run_can_be_seen_in_hindsight(foretold):
    rows = night(10, {'IA': 50.0}, 7)
    whole = TrackedNight(foretold, PowerOnZero(0.0, 0.0), int(rows['time'][0] * 1e9) - 10**9)
    whole.keep()
    for i in range(len(rows)):
        whole.take(rows.select([i]))
    back = whole.smoothed()
    assert len(back.stamps) == len(rows) - 5


def test_rates_of_the_nights_are_where_the_filter_begins(foretold):
    facts = Tracker(foretold, 0).facts
    weights = rate_weights_of(foretold.provenance[RATES], facts)
    zeros = np.array([fact['zero'] for fact in facts]) / ARCSEC
    assert weights.sum() == pytest.approx(1.0)
    # 2 arcsec in the root of an hour were simulated
    assert 1.0 < np.exp(weights @ np.log(zeros)) < 4.0
    both = Tracker(foretold, 0, sensors=['difference']).facts
    assert rate_weights_of(foretold.provenance[RATES], both).sum() == pytest.approx(1.0)
    assert rate_weights_of(None, facts) is None
    assert rate_weights_of([{'zero_arcsec': 1e3, 'lean_arcsec': 1.0, 'chance': 1.0}], facts) is None


@pytest.mark.parametrize('damage', [
    {PAST: {'names': ['IA']}}, {PAST: 'text'}, {RATES: [{'zero_arcsec': 'x'}]}])
def test_what_is_damaged_is_said(foretold, damage):
    bad = PointingModel(foretold.terms, foretold.covariance,
                        provenance=foretold.provenance | damage)
    with pytest.raises(ValueError, match='damaged.*telescope-mount season'):
        TrackedNight(bad, PowerOnZero(0.0, 0.0), 0)
