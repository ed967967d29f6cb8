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

"""Exposures on instruments and a clock of the test, without ROS."""


import numpy as np
import pytest
from bench import SECOND, START, Bench

from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.model import PointingModel
from pointing_model.sky.places import observed_place
from pointing_model.sky.refraction import DEFAULT_WEATHER
from pointing_model.sky.site import DEFAULT_SITE
from pointing_model.sky.star_catalogue import POLARIS_HIP, load_catalogue
from pointing_model.zero import PowerOnZero
from pointing_model.zero_drift import KEY, AxisFollowing, Following
from telescope_mount.observing.instruments import ABSOLUTE, CAMERA, MOUNT


def test_a_star_far_off_is_centred_at_most_three_times():
    bench = Bench('polaris 1')
    off = np.array([150.0, -60.0])
    bench.miss = lambda number: off * (1.0 if number == 1 else 0.45) * ARCSEC
    bench.run()
    assert len(bench.commands) == 3 and len(bench.rows) == 1
    # each command goes on from where the star was found
    polaris = load_catalogue(hip=[POLARIS_HIP])
    for number, track in enumerate(bench.commands):
        star = np.ravel(observed_place(polaris, track.start * 1e-9, DEFAULT_SITE, DEFAULT_WEATHER))
        beside = track.angles[0] - star
        np.testing.assert_allclose(
            [wrap(beside[0]) * np.cos(star[1]) / ARCSEC, beside[1] / ARCSEC],
            off * (0.0, 1.0, 1.45)[number], rtol=0, atol=0.5)


def test_a_camera_that_does_not_see_the_mount_move_gives_no_row():
    """Until it has seen by how much the mount is moved on purpose, beside the next star."""
    bench = Bench('stars 1, polaris 1')
    moved = -60.0 * ARCSEC * np.array([np.cos(np.pi / 8), np.sin(np.pi / 8)])
    bench.miss = lambda number: (np.array([150.0, -60.0]) * ARCSEC if number < 4
                                 else moved * (number == 5))
    bench.run()
    assert len(bench.commands) == 6 and len(bench.rows) == 1
    assert bench.plan.progress.lost == 1
    assert bench.refused == ['a star that was centred is as far off as before']
    # what it seemed to teach is forgotten
    star = bench.rows[0]
    assert abs(wrap(bench.commands[3].angles[1, 0] - star['az'][0])) < 2 * DEG
    assert bench.instruments.health.sentences == {}


def test_nothing_is_observed_while_two_publish_one_instrument():
    bench = Bench('stars 2')
    health = bench.instruments.health
    bench.until(lambda: len(bench.rows) == 1)
    health.publishers(CAMERA, ['/mount/camera', '/mount/other'])
    bench.waits('an end: camera: published by /mount/camera and /mount/other; end all but one')
    assert len(bench.rows) == 1
    health.publishers(CAMERA, ['/mount/camera'])
    assert bench.run() == ('done', 'plan finished')
    assert len(bench.rows) == 2 and health.sentences == {}


def test_an_encoder_that_stays_where_it_was_is_named():
    bench = Bench('stars 1')
    bench.until(lambda: bench.commands)
    bench.pending = None
    bench.stamp = bench.commands[0].end + 50 * SECOND
    for _ in range(2):
        bench.read(bench.stamp, np.array([3.0, 0.8]))
        bench.stamp += SECOND
    bench.until(lambda: len(bench.commands) > 1)
    alarm, = bench.instruments.health.sentences.values()
    assert alarm.startswith('instrument mount and incremental encoder: contradicts the commanded '
                            'motion: its reading has not changed since the command')


@pytest.mark.parametrize('changed, wanted', [(False, 40.0), (True, 0.0)])
def test_what_was_learned_of_a_star_holds_until_a_new_zero(changed, wanted):
    bench = Bench('polaris 1, power_cycle, polaris 1')
    bench.miss = lambda number: (40.0 * ARCSEC, 0.0)
    bench.waits('a server of /mount/power_cycle')
    if changed:
        bench.takes_zero(START, 0.0, 0.0)
    bench.homes()
    bench.offers('power_cycle')
    bench.until(lambda: bench.plan.progress.block == 2)
    bench.read(bench.stamp + SECOND, bench.position)
    bench.until(lambda: len(bench.commands) == 2)
    track = bench.commands[1]
    star = np.ravel(observed_place(load_catalogue(hip=[POLARIS_HIP]), track.start * 1e-9,
                                   DEFAULT_SITE, DEFAULT_WEATHER))
    beside = wrap(track.angles[0, 0] - star[0]) * np.cos(star[1])
    assert beside / ARCSEC == pytest.approx(wanted, abs=0.1)


def test_a_star_that_is_not_there_is_given_up_after_three_blanks():
    bench = Bench('stars 3')
    bench.miss = lambda number: (np.nan, np.nan) if number in (2, 3, 4) else (0.0, 0.0)
    assert bench.run() == ('done', 'plan finished')
    assert len(bench.commands) == 5 and len(bench.rows) == 2
    # three exposures of the same star, then the next
    moves = [np.abs(np.diff([a.angles[0], b.angles[0]], axis=0)).max() > 1 * DEG
             for a, b in zip(bench.commands, bench.commands[1:])]
    assert moves == [True, False, False, True]
    progress = bench.plan.progress
    assert (progress.lost, progress.done, progress.total) == (1, 3, 3)
    # one blank may have been under way at the command
    once = Bench('stars 3')
    once.miss = lambda number: (np.nan, np.nan) if number == 2 else (0.0, 0.0)
    once.run()
    assert len(once.rows) == 3 and once.plan.progress.lost == 0


def test_a_blind_star_gets_what_the_counts_had_wandered_at_the_one_before():
    follows = Following({'el': AxisFollowing(np.zeros(4), {1: 2.0 * ARCSEC})})
    bench = Bench('check 3')
    bench.in_force.update_model(PointingModel({'IA': 0.0}, provenance={
        KEY: follows.document(),
        'zeros_in_force': [{'run': 1, 'az_arcsec': 0.0, 'el_arcsec': 0.0}]}).to_json())
    bench.in_force.update_zero(START, PowerOnZero(0.0, 0.0, run=1))

    def wanders(number):
        bench.error = np.array([0.0, 5.0 * number + 2.0]) * ARCSEC
        return 0.0, 0.0

    bench.miss = wanders
    # the counts have changed between the reading before and after the first exposure
    bench.error = np.array([0.0, 2.0]) * ARCSEC
    bench.run()
    sent = [(track.angles[1, 1] - row['el'][0]) / ARCSEC
            for track, row in zip(bench.commands, bench.rows)]
    seen = [(row['el_enc'][0] - row['el_abs'][0]) / ARCSEC - 2.0 for row in bench.rows]
    assert sent == pytest.approx([0.0, *seen[:2]], abs=0.1) and seen[1] > 5.0


# --- instruments that are silent or slow ---------------------------------------------------------


@pytest.mark.parametrize('mute, named', [
    ({CAMERA}, CAMERA), ({ABSOLUTE}, ABSOLUTE),
    ({MOUNT, ABSOLUTE, CAMERA}, f'{MOUNT}, {ABSOLUTE}, {CAMERA}')])
def test_who_is_silent_is_named_and_asked_again(mute, named):
    bench = Bench('polaris 1')
    bench.answers -= mute
    bench.waits(f'an answer of {named}')
    assert bench.wall >= 1005.0 and len(bench.commands) == 2
    assert bench.plan.progress.observations == 0
    bench.answers |= mute
    assert bench.run() == ('done', 'plan finished')
    assert len(bench.rows) == 1
    assert bench.statuses[-1][0].state == 'done'


def test_the_time_of_an_answer_is_that_of_the_wall():
    bench = Bench('polaris 1', answer_timeout_s=60.0)
    bench.answers.remove(CAMERA)
    bench.until(lambda: len(bench.commands) == 2)
    assert bench.wall == pytest.approx(1060.0, abs=0.5)


def test_a_mount_that_does_not_come_on_target_is_commanded_again():
    bench = Bench('polaris 1')
    bench.error = np.array([60.0, 60.0]) * ARCSEC
    bench.until(lambda: len(bench.commands) == 1 and bench.pending is None)
    # it answers for as long as the track is, but off the target
    for _ in range(100):
        if len(bench.commands) > 1:
            break
        bench.wall += 0.01
        bench.read(bench.stamp + 2 * SECOND, bench.position)
        bench.plan.advance()
    assert bench.plan.text == 'the mount to come on target: 91 arcsec off'
    bench.error = np.zeros(2)
    assert bench.run() == ('done', 'plan finished')


def test_a_frame_without_a_reading_is_refused_with_its_reason():
    bench = Bench('home, polaris 1')
    bench.homes()
    reads = bench.read

    def fails(stamp, angles):
        if len(bench.commands) == 1 and not bench.refused:
            bench.error = np.full(2, np.nan)
        reads(stamp, angles)
    bench.read = fails
    assert bench.run() == ('done', 'plan finished')
    assert bench.refused and 'home the encoder' in bench.refused[0]


def test_a_mount_without_an_absolute_encoder_is_observed_with_the_other():
    bench = Bench('stars 3', absolute=False)
    assert bench.run() == ('done', 'plan finished')
    # no column: a row of NaN would be an encoder that gave no angle
    assert len(bench.rows) == 3 and not any('az_abs' in row.columns for row in bench.rows)
    assert bench.plan.text == 'plan finished' and bench.instruments.health.sentences == {}


def test_a_dead_axis_of_the_absolute_encoder_does_not_take_the_other_with_it():
    bench = Bench('stars 3')
    bench.second = lambda angles: (angles[0], np.nan)
    bench.miss = lambda number: (3.0 * ARCSEC, -4.0 * ARCSEC)
    bench.run()
    assert len(bench.rows) == 3 and not bench.refused
    for row in bench.rows:
        assert np.isnan(row['el_abs'][0])
        assert wrap(row['az_abs'][0] - row['az_enc'][0]) == pytest.approx(0.0, abs=1e-9)
