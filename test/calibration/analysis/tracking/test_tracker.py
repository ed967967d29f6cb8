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

import copy
import json
import pickle

import numpy as np
import pytest

from calibration.analysis.tracking.innovations import HONEST, OVER, UNDER, FilterConsistency
from calibration.analysis.tracking.motion_causes import TrackingSettings, lean_of_base
from calibration.analysis.tracking.tracker import Tracker
from calibration.report.wording import worded, wording
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.harmonics import Harmonics
from pointing_model.model import PointingModel
from pointing_model.mounts import ALTAZ, Mount

HOUR = 3_600_000_000_000
MINUTE = HOUR // 60
TERMS = {'IA': 140.0, 'IE': -80.0, 'CA': 45.0, 'NPAE': -20.0, 'AN': 35.0, 'AW': -25.0,
         'TF': 18.0, 'TX': 6.0}
SOUTH = Mount.equatorial(-30 * DEG, 'german')


def known(tracker):
    """All that a tracker knows by now, to the bit."""
    bank = tracker.filter
    return (tracker.plain.terms, tracker.stamp, tracker.stars, bank.histories, [
        part.tobytes() for part in (bank.means, bank.covariances, bank.log_weights, bank.unseen)],
        dict(vars(tracker.consistency)))


def model(sigma=0.3, mount=ALTAZ, **other):
    """Of an ordinary mount; other terms in arcsec."""
    names = TERMS if mount.vertical else mount.names.physical
    terms = {**dict(zip(names, TERMS.values())), **other}
    return PointingModel({name: value * ARCSEC for name, value in terms.items()},
                         np.eye(len(terms)) * (sigma * ARCSEC) ** 2, mount=mount)


class Sky:
    """Stars of a mount whose terms are those of `model` and what is added to them."""

    def __init__(self, seed, mount=ALTAZ, noise=1.0):
        self.rng, self.mount, self.noise = np.random.default_rng(seed), mount, noise * ARCSEC
        self.added = {}  # arcsec

    def tell(self, tracker, stamp, off=(0.0, 0.0)):
        """A star, `off` arcsec beside the true one."""
        az, el = self.rng.uniform(0.2, 2.8), self.rng.uniform(25 * DEG, 75 * DEG)
        terms = {name: value / ARCSEC for name, value in model(mount=self.mount).terms.items()}
        terms |= {name: terms[name] + value for name, value in self.added.items()}
        true = PointingModel({n: v * ARCSEC for n, v in terms.items()}, mount=self.mount)
        x, y = np.array(true.offsets(az, el)) + self.rng.normal(size=2) * self.noise
        return tracker.star(stamp, az, el, x + off[0] * ARCSEC, y + off[1] * ARCSEC, self.noise)


@pytest.mark.parametrize('mount', [ALTAZ, SOUTH])
def test_zeros_and_lean_are_followed_on_any_mount(mount):
    sky, tracker = Sky(1, mount), Tracker(model(mount=mount), 0)
    first, second = mount.names.index
    lean = mount.names.named('AW')
    for k in range(1, 31):
        sky.added = {first: 6.0 * k / 6.0, second: -3.0 * k / 6.0, lean: 0.5 * k / 6.0}
        assert sky.tell(tracker, 10 * k * MINUTE).taken
    terms, covariance = tracker.terms()
    for name, sigma in zip(terms, np.sqrt(np.diag(covariance))):
        start = model(mount=mount).terms[name] / ARCSEC
        assert abs(terms[name] / ARCSEC - start - sky.added.get(name, 0.0)) < 4.0 * sigma / ARCSEC
    assert 1.0 < tracker.rates()['zero'] / ARCSEC < 10.0
    assert tracker.model().mount == mount
    assert tracker.model().provenance['tracked']['stars'] == 30


@pytest.mark.parametrize('jump, who', [
    ({'IE': 25.0}, 'elevation'), ({'IE': 3600.0}, 'elevation'),
    ({'IE': 25.0, 'IA': -30.0}, 'azimuth and elevation'),  # a restart: not wrong stars for ever
    ({'IE': 600.0, 'IA': 900.0}, 'azimuth and elevation')])
def test_a_jump_is_called_by_its_second_star_and_a_wrong_star_is_none(jump, who):
    sky, tracker = Sky(2), Tracker(model(), 0)
    said = {}
    for k in range(36):
        sky.added = jump if k >= 16 else {}
        heard = sky.tell(tracker, 10 * k * MINUTE, off=(60.0, -90.0) if k == 8 else (0.0, 0.0))
        said |= {k: worded(heard.events)} if heard.events else {}
        if k == 8:
            assert heard.chances['wrong star'] > 0.9
    assert list(said) == [9, 17]
    assert said[9][0].startswith('star 8 is a wrong star')
    assert [text.split(' (')[0] for text in said[17]] == [f'{who}: jumped before star 16']
    assert abs(tracker.terms()[0]['IE'] / ARCSEC - TERMS['IE'] - jump['IE']) < 2.0
    assert tracker.consistency.noise == tracker.consistency.walk == 1.0


@pytest.mark.parametrize('knock', [{'AN': 90.0, 'AW': -60.0}, {'CA': 40.0, 'IE': 30.0}])
def test_a_mount_that_was_knocked_has_no_wrong_stars(knock):
    sky, tracker = Sky(2), Tracker(model(), 0)
    called = []
    for k in range(30):
        sky.added = knock if k >= 12 else {}
        called += sky.tell(tracker, 10 * k * MINUTE).events
    assert worded(called)[-1].startswith('mount or camera: jumped before star 12')
    terms = tracker.terms()[0]
    assert all(abs(terms[name] / ARCSEC - TERMS[name] - by) < 8.0 for name, by in knock.items())


@pytest.mark.parametrize('who, zero, difference', [
    ('incremental encoder', 20.0, -20.0), ('absolute encoder', 0.0, 20.0),
    ('tube or sky', 20.0, 0.0)])
def test_the_encoders_tell_who_jumped(who, zero, difference):
    sky, tracker = Sky(3), Tracker(model(), 0, sensors=['difference'])
    called = []
    for k in range(16):
        sky.added = {'IA': zero} if k >= 10 else {}
        for axis in (0, 1):
            d = 1234.5 + sky.rng.normal() * 0.3 + (difference if k >= 10 and axis == 0 else 0.0)
            called += tracker.difference(10 * k * MINUTE, axis, d * ARCSEC, 0.3 * ARCSEC).events
        called += sky.tell(tracker, 10 * k * MINUTE).events
    assert [sentence.split(' (')[0] for sentence in worded(called)] == [
        f'{who}, azimuth: jumped before star 10']


def test_an_inclinometer_takes_the_lean_of_the_pier_before_a_star_does():
    ahead = []
    for sensors in ((), ('inclinometer',)):
        sky = Sky(4)
        tracker = Tracker(model(), 0, sensors=sensors)
        for k in range(12):
            sky.tell(tracker, 10 * k * MINUTE)
            tracker.inclinometer(10 * k * MINUTE, 5 * ARCSEC, -2 * ARCSEC, 0.2 * ARCSEC)
        heard = tracker.inclinometer(115 * MINUTE, 17 * ARCSEC, -2 * ARCSEC, 0.2 * ARCSEC)
        assert heard.taken == bool(sensors)
        ahead.append(tracker.terms()[0]['AN'] / ARCSEC - TERMS['AN'])
    assert abs(ahead[0]) < 2.0 and abs(ahead[1] - 12.0) < 2.0


@pytest.mark.parametrize('mount', [ALTAZ, Mount.equatorial(50 * DEG), Mount.free(0.3, 0.9, 0.5)])
def test_a_base_that_leans_turns_the_axes(mount):
    az, el, lean = np.array([0.4, 2.0, 4.5]), np.array([0.5, 1.0, 0.8]), 2.0 * ARCSEC
    for vector, terms in zip(((-lean, 0.0, 0.0), (0.0, -lean, 0.0)), lean_of_base(mount)):
        leant = Mount(mount.kind if mount.kind != 'altaz' else 'free',
                      [np.array(v) + np.cross(vector, v) for v in mount.frame])
        want = np.array(leant.axes_of(az, el))
        first, second = mount.axes_of(az, el)
        x, y = PointingModel({n: v * lean for n, v in terms.items()}, mount=mount,
                             geometry='first_order').offsets(first, second)
        np.testing.assert_allclose(wrap(want[0] - first) * np.cos(second), x, atol=1e-3 * ARCSEC)
        np.testing.assert_allclose(want[1] - second, y, atol=1e-3 * ARCSEC)


def test_from_its_state_it_goes_on_to_the_bit():
    def told(tracker, sky, first, last):
        out = []
        for k in range(first, last):
            sky.added = {'IA': 70.0} if k >= 9 else {}  # far enough for the model to be moved
            tracker.difference(10 * k * MINUTE, k % 2, sky.rng.normal() * ARCSEC, ARCSEC)
            out.append(sky.tell(tracker, 10 * k * MINUTE, off=(200.0, 0.0) if k == 5 else (0, 0)))
        return json.dumps(worded([heard.document() for heard in out]))

    settings = TrackingSettings(memory_h={'TF': 3.0}, walks={'CA': 0.1 * ARCSEC})
    whole, sky = Tracker(model(), 0, sensors=['difference'], settings=settings), Sky(6)
    told(whole, sky, 0, 11)
    again = pickle.loads(pickle.dumps(whole))
    other = Sky(0)
    other.rng.bit_generator.state = sky.rng.bit_generator.state
    assert told(again, other, 11, 20) == told(whole, sky, 11, 20)
    assert known(again) == known(whole)


def test_what_cannot_be_is_refused_in_a_line_and_changes_nothing():
    sky, tracker = Sky(7), Tracker(model(), 0)
    sky.tell(tracker, HOUR)
    before = known(tracker)
    x, sigma = 10 * ARCSEC, ARCSEC
    for heard, words in (
            (tracker.star(HOUR - 1, 1.0, 1.0, x, x, sigma), 'before the last'),
            (tracker.star(HOUR, 1.0, 1.0, x, x, sigma), 'counted once'),
            (tracker.star(2 * HOUR, 1.0, np.nan, x, x, sigma), 'not finite'),
            (tracker.star(2 * HOUR, 1.0, 1.0, x, np.inf, sigma), 'not finite'),
            (tracker.star(2 * HOUR, 1.0, 1.0, x, x, 0.0), 'sigma'),
            (tracker.star(np.nan, 1.0, 1.0, x, x, sigma), 'stamp'),
            (tracker.difference(2 * HOUR, 0, x, sigma), 'not a sensor'),
            (tracker.power_on(2 * HOUR, sigma=np.nan), 'sigma')):
        assert not heard.taken and words in wording(heard.why) and '\n' not in wording(heard.why)
    assert known(tracker) == before


def test_a_gap_of_hours_and_a_power_on_widen():
    sky, tracker = Sky(8), Tracker(model(), 0)
    for k in range(12):
        sky.tell(tracker, 10 * k * MINUTE)
    before = float(tracker.expected(1.0, 1.0).radial[0])
    other = copy.deepcopy(tracker)
    heard = sky.tell(tracker, 9 * HOUR)
    assert heard.taken and 'uncertainty of a new night' in wording(heard.why)
    assert np.sqrt(np.trace(heard.covariance)) > 15 * ARCSEC > 3 * before
    assert other.power_on(2 * HOUR, axes=[1]).taken
    covariance = other.expected(1.0, 1.0).covariance[0]
    assert np.sqrt(covariance[1, 1]) > 59 * ARCSEC > 10 * np.sqrt(covariance[0, 0])


def test_models_that_are_none_are_refused_or_widened():
    bad = np.eye(8)
    bad[0, 0] = -1.0
    with pytest.raises(ValueError, match='negative'):
        Tracker(PointingModel(model().terms, bad * ARCSEC**2), 0)
    with pytest.raises(ValueError, match='sensor'):
        Tracker(model(), 0, sensors=['polaris'])
    with pytest.raises(ValueError, match='wrong'):
        TrackingSettings(wrong=0.7)
    with pytest.raises(ValueError, match='positive'):
        TrackingSettings(zeros=(0.0,))
    with pytest.raises(ValueError, match='no term TX'):
        Tracker(PointingModel({'IA': 0.0}), 0, settings=TrackingSettings(walks={'TX': ARCSEC}))
    tracker = Tracker(PointingModel({'IE': 0.0, 'TF': 10 * ARCSEC}), 0)
    assert 'singular' in wording(tracker.notes[0]) and 'IA' in wording(tracker.notes[1])
    assert tracker.expected(1.0, 1.0).radial[0] > 100 * ARCSEC
    for k in range(1, 8):
        Sky(k).tell(tracker, k * MINUTE)
    assert list(tracker.terms()[0]) == ['IE', 'TF', 'IA']


def test_noise_that_is_larger_than_given_is_said_and_taken():
    sky, tracker = Sky(9, noise=1.0), Tracker(model(), 0)
    said = []
    for k in range(40):
        heard = sky.tell(tracker, 10 * k * MINUTE, off=8.0 * sky.rng.normal(size=2))
        said += [wording(heard.consistency)] if heard.consistency else []
    assert said and said[0].startswith('over-confident') and tracker.consistency.noise > 1.3


@pytest.mark.parametrize('size, verdict, side', [(0.4, UNDER, -1.0), (1.0, HONEST, 0.0),
                                                 (2.5, OVER, 1.0)])
def test_the_verdict_stands_beside_the_ratio_it_rests_on(size, verdict, side):
    rng, confidence = np.random.default_rng(3), FilterConsistency()
    said = worded([one for one in (confidence.add(size * rng.normal(size=2)) for _ in range(16))
                   if one])
    assert confidence.verdict == verdict
    if side == 0.0:
        assert said == [] and wording(confidence.finding()) == 'honest'
        return
    # above 1 where errors are larger than predicted, below where they are smaller
    count, ratio = confidence.tested
    assert count == 12 and side * np.log(ratio) > side * np.log(size) - 0.3 > 0.0
    assert wording(confidence.finding()) == (
        f'{verdict}: errors of 12 stars were {ratio:.2f} times the predicted ones (RMS)')
    assert said[0].startswith(wording(confidence.finding()))


def test_a_filter_that_was_widened_too_far_is_not_called_over_confident():
    rng, confidence = np.random.default_rng(5), FilterConsistency()
    for _ in range(12):
        confidence.add(4.0 * rng.normal(size=2))
    assert confidence.verdict == OVER and confidence.tested[1] > 1.0 and confidence.noise > 2.0
    (said,) = filter(None, (confidence.add(0.3 * rng.normal(size=2)) for _ in range(12)))
    said = wording(said)
    assert confidence.noise > 1.0 and said.startswith('under-confident')
    assert confidence.verdict == UNDER and confidence.tested[1] < 1.0


def test_the_error_ahead_grows_with_what_drifts_and_jumps_are_told_apart():
    sky, tracker = Sky(10), Tracker(model(), 0)
    for k in range(24):
        sky.tell(tracker, 10 * k * MINUTE)
    now, later = (tracker.expected(1.0, [0.5, 1.0], s) for s in (0.0, 3600.0))
    assert now.radial.shape == (2,) and (later.radial > now.radial).all()
    grown = np.trace(later.covariance[0] - now.covariance[0]) / ARCSEC**2
    zero, tilt = (tracker.rates()[name] / ARCSEC for name in ('zero', 'tilt'))
    np.testing.assert_allclose(grown, zero**2 * (1 + np.cos(0.5) ** 2)
                               + tilt**2 * (1 + np.sin(0.5) ** 2), rtol=0.02)
    assert now.jump == 0.0 < later.jump < 0.1


def test_harmonics_of_the_model_stay_and_their_error_counts():
    rng = np.random.default_rng(11)
    series = Harmonics('zenith', *rng.normal(size=(2, 13)) * 20.0 * ARCSEC,
                       np.eye(26) * (2.0 * ARCSEC) ** 2)
    with_series = PointingModel(model().terms, model().covariance, series)
    tracker, bare = Tracker(with_series, 0), Tracker(model(), 0)
    for k in range(12):
        az, el = rng.uniform(0.2, 2.8), rng.uniform(0.5, 1.3)
        noise = rng.normal(size=2) * ARCSEC
        for one, of in ((tracker, with_series), (bare, model())):
            one.star(k * MINUTE, az, el, *(np.array(of.offsets(az, el)) + noise), ARCSEC)
    for name, value in tracker.terms()[0].items():
        assert value == pytest.approx(bare.terms()[0][name], abs=1e-4 * ARCSEC)
    assert tracker.model().harmonics == series
    more = tracker.expected(1.0, 1.0).covariance - bare.expected(1.0, 1.0).covariance
    np.testing.assert_allclose(np.diag(more[0]), np.ravel(series.variance(
        np.array([1.0]), np.array([1.0]))), rtol=1e-6)
