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
from encoder_night import cross_check

from calibration.analysis.encoders.count_drift import count_drift
from calibration.analysis.encoders.zero_following import zero_following
from calibration.calibration_state import CalibrationState
from msg_tools.units import ARCSEC, DEG
from pointing_model.model import PointingModel
from pointing_model.pointing_terms import PHYSICAL
from pointing_model.runs.run import PointingRun
from pointing_model.sky.star_catalogue import POLARIS_HIP
from pointing_model.zero_drift import KEY, Following

MOUNT = PointingModel(dict(zip(PHYSICAL, np.array([310, -170, 46, -23, 37, -21, 15]) * ARCSEC)))
START = 1_768_482_000.0
NOISE = 0.33  # of the absolute encoder
pytestmark = pytest.mark.usefixtures('nothing_expected', 'short_diagnosis')


def walk_of(seed, step, n=106):
    return np.cumsum(np.random.default_rng(seed + 500).normal(size=n)) * step


def night(seed, drift=0.0, who='enc', axis='el', stars=90, polaris=16, kept=0, noise=1.0,
          bent=None):
    """Stars, Polaris and blind stars; `drift` (n,) arcsec is what encoder `who` reads too much."""
    n = stars + polaris + kept
    rng = np.random.default_rng(seed)
    az, el = rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(0.35, 0.99, n))
    pole = slice(stars, stars + polaris)
    az[pole], el[pole] = 0.3 * DEG + 1e-4 * np.arange(polaris), 34.9 * DEG
    star = 1000.0 + np.arange(n)
    star[pole] = POLARIS_HIP
    axes = np.array(MOUNT.sky_to_encoder(az, el))
    seen = noise * rng.normal(size=(2, n)) * ARCSEC / [np.cos(el), np.ones(n)]
    columns = {
        'time': START + 15.0 * np.arange(n), 'run': np.ones(n), 'star': star, 'az': az, 'el': el,
        'check': np.repeat([0.0, 1.0], [stars + polaris, kept]),
        'miss_x': np.zeros(n), 'miss_y': np.zeros(n)}
    own = {'enc': 0.02, 'abs': NOISE}
    for encoder in ('enc', 'abs'):
        reading = axes + seen + own[encoder] * rng.normal(size=(2, n)) * ARCSEC
        if encoder == 'enc':
            reading[1] += 0.4 * np.cos(el - 1.0) * ARCSEC  # its disc off its axis
            if bent is not None:
                reading[0] += bent(az) * ARCSEC
        if encoder == who:
            reading[('az', 'el').index(axis)] += np.asarray(drift) * ARCSEC
        columns[f'az_{encoder}'], columns[f'el_{encoder}'] = reading
    return PointingRun(columns)


def plain(n, seed):
    """Differences, angles and power-on of a quiet axis."""
    rng = np.random.default_rng(seed)
    return NOISE * rng.normal(size=n) * ARCSEC, rng.uniform(0, 2 * np.pi, n), np.ones(n)


def test_white_noise_is_no_walk():
    assert sum(count_drift(*plain(100, seed)) is not None for seed in range(60)) == 0
    assert count_drift(*plain(15, 1)) is None and count_drift(*plain(0, 1)) is None


def test_a_walk_is_found_and_followed_to_its_noise():
    found = 0
    for seed in range(20):
        difference, angle, run = plain(100, seed)
        path = walk_of(seed, 0.35, 100)
        walk = count_drift(difference + path * ARCSEC, angle, run)
        found += walk is not None
        if walk is not None:
            left = walk.path / ARCSEC - (path - path.mean())
            assert np.sqrt(np.mean((left - left.mean()) ** 2)) < 0.6
            assert 0.15 < walk.step / ARCSEC < 0.8 and 0.1 < walk.noise / ARCSEC < 0.6
    assert found >= 18


@pytest.mark.parametrize('what', ['disc', 'finer', 'step', 'drift', 'spikes', 'power-on'])
def test_what_else_a_difference_does_is_no_walk(what):
    alarms = 0
    for seed in range(20):
        difference, angle, run = plain(100, seed)
        alternatives = ()
        if what in ('disc', 'finer'):
            # in order of azimuth what follows the angle follows the time
            angle = np.sort(angle)
            order = 1 if what == 'disc' else 4
            difference = difference + 9.0 * np.cos(order * angle - 0.7) * ARCSEC
        elif what == 'step':
            column = 1.0 * (np.arange(100) > 60)
            difference, alternatives = difference + 8.0 * column * ARCSEC, ((column, 2),)
        elif what == 'drift':
            column = np.linspace(-0.5, 0.5, 100)
            difference, alternatives = difference + 8.0 * column * ARCSEC, ((column, 1),)
        elif what == 'spikes':
            difference[[20, 70]] += 1200.0 * ARCSEC
        else:
            run = np.repeat([1.0, 2.0], 50)
            difference = difference + 300.0 * run * ARCSEC
        alarms += count_drift(difference, angle, run, alternatives) is not None
    assert alarms == 0


def test_the_stars_say_which_encoder_drifts():
    for seed, axis in ((1, 'el'), (2, 'az')):
        path = walk_of(seed, 0.6)
        assert list(zero_following(night(seed, path, axis=axis)).axes) == [axis]
        assert not zero_following(night(seed, path, who='abs', axis=axis))
    assert not zero_following(night(3))
    alone = night(1, walk_of(1, 0.6))
    assert not zero_following(PointingRun({k: v for k, v in alone.columns.items()
                                     if not k.endswith('_abs')}))
    # too few stars to tell
    assert not zero_following(night(1, walk_of(1, 0.9, 28), stars=8, polaris=20))


def test_a_coupling_that_winds_up_is_no_walk():
    mistaken = despite = beside = 0
    for seed in range(3):
        rng = np.random.default_rng(seed + 70)
        # it comes from one side for some stars, then from the other
        side = np.cumprod(np.where(rng.uniform(size=106) < 0.1, -1.0, 1.0))
        for path in (0.0, walk_of(seed, 0.8)):
            rows = night(seed, 3.0 * side + path, axis='az')
            known = PointingRun({**rows.columns, 'approach_az': side, 'approach_el': 0.0 * side})
            if np.ndim(path):
                beside += list(zero_following(known).axes) == ['az']
            else:
                mistaken += bool(zero_following(rows))
                despite += bool(zero_following(known))
    assert mistaken == despite == 0  # where the side is not known; where it is
    assert beside >= 2  # what walks beside it still does


def test_noise_that_soon_forgets_is_no_walk():
    alarms = 0
    for seed in range(40):
        difference, angle, run = plain(106, seed)
        for k in range(1, len(difference)):
            difference[k] = 0.6 * difference[k - 1] + 0.8 * difference[k]
        walk = count_drift(difference, angle, run)
        alarms += walk is not None and walk.lead > 2.0 * np.log(100.0)
    assert alarms == 0


def test_a_walk_in_doubt_is_not_told_where_no_star_shows_it():
    """Noise with a memory of three rows, half of a second of arc: in these nights likelier a walk
    than not, and not a hundred times.
    """
    for seed in (19, 20):
        memory = np.random.default_rng(seed + 900).normal(size=106)
        memory *= np.sqrt(1.0 - 0.7**2)
        for k in range(1, len(memory)):
            memory[k] += 0.7 * memory[k - 1]
        assert cross_check(night(seed, 0.5 * memory)).alarms == []


def test_the_reference_is_of_a_power_on_of_the_absolute_encoder():
    rows = night(1, walk_of(1, 0.6, 166), kept=60)
    start = np.where(np.arange(166) < 120, START, START + 1800.0)
    cycled = PointingRun({**rows.columns, 'absolute_start': start})
    cycled['el_abs'][120:] += 40.0 * ARCSEC
    follows = zero_following(cycled)
    assert list(follows.axes) == ['el'] and follows.axes['el'].starts == {1: START}
    # seen again on Polaris since, it is followed from there
    cycled['star'][150:] = POLARIS_HIP
    assert zero_following(cycled).axes['el'].starts == {1: START + 1800.0}


def test_the_reason_is_named():
    alarm, = cross_check(night(1, walk_of(1, 0.6))).alarms
    assert alarm.startswith('elevation: incremental encoder: the counts of the elevation encoder '
                            'drift against the absolute encoder, by ')
    assert 'electromagnetic interference' in alarm and 'its zero follows the other' in alarm
    other, = cross_check(night(1, walk_of(1, 0.6), who='abs')).alarms
    assert other.startswith('elevation: absolute encoder drifts against the incremental one')
    assert cross_check(night(3)).alarms == []


def session(rows, blind=0):
    out = CalibrationState()
    for k in range(len(rows) - blind):
        out.add(rows.select([k]), k + 1)
    out.calibrate_zero()
    return out


def test_a_night_whose_counts_drift_points_as_a_quiet_one():
    path = walk_of(4, 0.7, 226)
    rows = night(5, path, kept=120)
    night_session = session(rows, blind=90)
    model, report = night_session.fit()
    follows = Following.from_model(model)
    assert list(follows.axes) == ['el'] and KEY in report
    found = night_session.diagnose()
    assert found.document['verdict'] == 'none' and found.document[KEY] == follows.document()
    assert found.document['notes'][0].startswith(
        'the counts of the elevation encoder drift against the absolute encoder: electromagnetic')
    assert Following.from_model(found.model).document() == follows.document()
    blind = follows.corrected(rows).select(np.arange(136, 226))
    left = np.hypot(*found.model.residuals(blind, zero=found.chosen.zeros.newest)) / ARCSEC
    # 1.41 of the stars, 0.7 of the way to them
    assert np.sqrt(np.mean(left**2)) < 1.8
    without = session(PointingRun({k: v for k, v in rows.columns.items()
                                   if not k.endswith('_abs')}), blind=90)
    plain_model, _ = without.fit()
    raw = np.hypot(*plain_model.residuals(
        rows.select(np.arange(136, 226)), zero=without.active_zeros.newest)) / ARCSEC
    assert np.sqrt(np.mean(raw**2)) > 2.5
    assert not Following.from_model(plain_model)


def test_a_disc_off_its_axis_that_the_model_lacks_is_no_alarm():
    rows = night(6, bent=lambda az: 9.0 * np.cos(az - 0.8), kept=20)
    night_session = session(rows)
    _, report = night_session.fit()
    assert report['witnesses']['alarms'] == []
    found = night_session.diagnose()
    assert found.document['applied'] == ['azimuth_encoder_1']
    report = night_session.report
    assert report['witnesses']['alarms'] == [] and report['verdict'] == 'identified'


def test_what_the_blind_stars_have_seen_decides_too():
    # it begins to walk when the night's stars are done
    path = np.concatenate([np.zeros(106), walk_of(4, 1.0, 120)])
    rows = night(5, path, kept=120)
    night_session = session(rows, blind=60)
    model, _ = night_session.fit()
    assert not Following.from_model(model)
    found = night_session.diagnose()
    assert list(Following.from_model(found.model).axes) == ['el'] and found.document['published']
    night_session.add(rows.select(np.arange(166, 226)), 1000)
    judged = night_session.check_on_blind_stars().document['judged']
    assert judged['rows'] == 60 and not judged['taken_back']
    assert judged['radial']['after_arcsec'] < 0.8 * judged['radial']['before_arcsec']


def test_of_many_rows_some_are_enough():
    path = walk_of(7, 0.4, 616)
    rows = night(8, path, stars=600)
    follows = zero_following(rows)
    assert list(follows.axes) == ['el']
    assert follows.axes['el'].step / ARCSEC == pytest.approx(0.4, rel=0.5)
    left = (rows['el_enc'] - follows.corrected(rows)['el_enc']) / ARCSEC - path
    assert np.std(left) < 0.5
