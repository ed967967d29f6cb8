"""The plan on instruments and a clock of the test, without ROS."""

import json
import logging
from types import SimpleNamespace

import numpy as np
import pytest

from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.following import KEY, AxisFollowing, Following
from pointing_model.in_force import InForce
from pointing_model.model import PointingModel
from pointing_model.observing.instruments import ABSOLUTE, CAMERA, MOUNT, Instruments
from pointing_model.observing.sequencer import Sequencer
from pointing_model.observing.table import Table
from pointing_model.sky import DEFAULT_SITE, DEFAULT_WEATHER, Site, observed_place
from pointing_model.star_catalogue import POLARIS_HIP, load_catalogue
from pointing_model.zero import RunZero

START = 1_768_482_000_000_000_000  # 2026-01-15T13:00:00
SECOND = 10**9
#: of the exposure after its command: on a knot, where every way to interpolate agrees
EXPOSURE = 20 * SECOND
SETTINGS = {
    'magnitude_limit': 3.5, 'star_seed': 1, 'min_elevation_deg': 20.0, 'max_elevation_deg': 85.0,
    'recentre_arcsec': 60.0, 'on_target_arcsec': 30.0, 'slew_rate_deg_s': 4.0,
    'answer_timeout_s': 5.0, 'satellite': '', 'satellite_interval_s': 90.0}


class Service:
    """A service of the bench; it answers at once."""

    srv_type = SimpleNamespace(Request=lambda: None)

    def __init__(self, bench, verb):
        self.bench, self.verb, self.srv_name = bench, verb, f'/mount/{verb}'

    def service_is_ready(self):
        return self.verb in self.bench.services

    def call_async(self, request):
        self.bench.calls.append(self.verb)
        answer = self.bench.services[self.verb]()
        return SimpleNamespace(
            done=lambda: True, add_done_callback=lambda callback: callback(None),
            result=lambda: SimpleNamespace(success=answer[0], message=answer[1]))


class Bench:
    """Mount, encoders, camera, clocks and the other side of every topic."""

    def __init__(self, plan='', homed=True, **settings):
        self.settings = SETTINGS | settings
        self.stamp, self.wall = START, 1000.0
        self.position = np.array([3.0, 0.8])
        self.error = np.zeros(2)  # of the encoder
        self.miss = lambda number: (1e-6 * ARCSEC * number, 0.0)  # rad, None: no frame
        self.answers = {MOUNT, ABSOLUTE, CAMERA}
        self.site, self.lacks = DEFAULT_SITE, []
        self.services, self.calls = {}, []
        self.commands, self.rows, self.tables, self.checks = [], [], [], []
        self.statuses, self.refused, self.pending = [], [], None
        self.instruments = Instruments(1, wall=lambda: self.wall)
        self.in_force, self.table = InForce(), Table()
        self.plan = Sequencer(self, self.instruments, self.in_force, self.table)
        if homed:
            self.read(self.stamp, self.position)
        if plan:
            self.plan.start(plan)

    # what the sequencer asks for

    def value(self, name):
        return self.settings[name]

    def sky(self):
        return self.site, DEFAULT_WEATHER

    def now(self):
        return self.stamp

    def waiting_for(self):
        return self.lacks

    def client(self, verb):
        return Service(self, verb)

    def get_logger(self):
        return logging.getLogger('bench')

    def refuse_frame(self, reason):
        self.refused.append(reason)

    def send_command(self, track):
        self.commands.append(track)
        self.pending = track

    def send_row(self, run, stamp):
        self.rows.append(run)

    def send_table(self, run, stamp):
        self.tables.append(run)

    def send_checks(self, text):
        self.checks.append(json.loads(text)['checks'])

    def send_status(self, progress, text):
        self.statuses.append((progress, text))

    # the instruments

    def read(self, stamp, angles):
        self.stamp = stamp
        if MOUNT in self.answers:
            self.instruments.take_incremental(stamp, tuple(angles + self.error), (0.0, 0.0))
        if ABSOLUTE in self.answers:
            self.instruments.take_absolute(stamp, tuple(angles))

    def tick(self):
        """What has been commanded is exposed, or a tenth of a second goes by."""
        track, self.pending = self.pending, None
        if track is None:
            self.wall += 0.1
        else:
            self.wall += 0.01
            at = track.start + EXPOSURE
            self.position = track.angles[1]
            self.read(at - SECOND // 2, self.position)
            miss = self.miss(len(self.commands))
            if CAMERA in self.answers and miss is not None:
                self.instruments.take_frame(at, *miss)
            self.read(at + SECOND // 2, self.position)
        self.plan.advance()

    def until(self, condition, ticks=2000):
        for _ in range(ticks):
            if condition():
                return self
            self.tick()
        raise AssertionError(f'{self.plan.progress}, {self.plan.text}')

    def run(self):
        """To the end of the plan; the state then, and its text."""
        self.until(lambda: not self.plan.busy)
        return self.plan.progress.state, self.plan.text

    def waits(self, text):
        return self.until(lambda: (self.plan.progress.state, self.plan.text) == ('waiting', text))

    # the other nodes

    def offers(self, verb, effect=lambda: None, answer=(True, 'done')):
        def serve():
            effect()
            return answer
        self.services[verb] = serve

    def homes(self):
        """A service that homes the encoder."""
        def home():
            self.error = np.zeros(2)
            self.read(self.stamp + SECOND, self.position)
        self.offers('home', home)

    def calibrates(self):
        self.plan.calibration_has(len(self.rows))

    def takes_model(self, stamp, zeros=()):
        self.in_force.take_model(PointingModel({'IA': 0.0}, provenance={
            'last_stamp_ns': stamp, 'zeros_in_force': list(zeros)}).to_json())
        self.plan.pointing_changed()

    def takes_zero(self, stamp, *angles):
        self.in_force.take_zero(stamp, RunZero(*angles))
        self.plan.pointing_changed()


def offset(run):
    return np.array(run.offsets()).ravel() / ARCSEC


# --- stars --------------------------------------------------------------------------------------


def test_a_plan_is_done_and_its_rows_are_what_was_seen():
    bench = Bench('stars 3, polaris 2')
    bench.miss = lambda number: np.array([4.0, 7.0]) * ARCSEC
    assert bench.run() == ('done', 'plan finished')
    assert [row['block'][0] for row in bench.rows] == [0, 0, 0, 1, 1]
    assert len({row['star'][0] for row in bench.rows[:3]}) == 3
    assert bench.rows[4]['star'][0] == POLARIS_HIP
    for row, track in zip(bench.rows, bench.commands, strict=True):
        stamp = track.start + EXPOSURE
        star = np.ravel(observed_place(
            load_catalogue(hip=[int(row['star'][0])]), stamp * 1e-9, DEFAULT_SITE,
            DEFAULT_WEATHER))
        assert row['time'][0] == pytest.approx(stamp * 1e-9, abs=1e-6)
        np.testing.assert_allclose([row['az'][0], row['el'][0]], star, rtol=0, atol=1e-12)
        x, y = wrap(track.angles[1, 0] - star[0]) * np.cos(star[1]), track.angles[1, 1] - star[1]
        np.testing.assert_allclose(
            offset(row), np.array([x, y]) / ARCSEC + [4.0, 7.0], rtol=0, atol=0.03)
    assert [len(table) for table in bench.tables] == [3, 5]
    progress, text = bench.statuses[-1]
    assert (progress.state, progress.observations, progress.done, progress.total) == (
        'done', 5, 2, 2)
    states = [(p.done, p.total) for p, _ in bench.statuses if p.block == 0 and p.step]
    assert states == sorted(states) and states[-1][1] == 3


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
    bench = Bench('stars 1, polaris 1')
    bench.miss = lambda number: np.array([150.0, -60.0]) * ARCSEC * (number < 4)
    bench.run()
    assert len(bench.commands) == 4 and len(bench.rows) == 1
    assert bench.plan.progress.lost == 1
    assert bench.refused == ['a star that was centred is as far off as before']
    # what it seemed to teach is forgotten
    star = bench.rows[0]
    assert abs(wrap(bench.commands[3].angles[1, 0] - star['az'][0])) < 2 * DEG
    assert bench.instruments.health.alarms == [
        'instrument camera: contradicts the commanded motion: a star 162 arcsec off was centred, '
        'and is 162 arcsec off']


def test_nothing_is_observed_while_two_publish_one_instrument():
    bench = Bench('stars 2')
    health = bench.instruments.health
    bench.until(lambda: len(bench.rows) == 1)
    health.publishers(CAMERA, ['/mount/camera', '/mount/other'])
    bench.waits('an end: camera: published by /mount/camera and /mount/other; end all but one')
    assert len(bench.rows) == 1
    health.publishers(CAMERA, ['/mount/camera'])
    assert bench.run() == ('done', 'plan finished')
    assert len(bench.rows) == 2 and health.alarms == []


def test_an_encoder_that_stays_where_it_was_is_named():
    bench = Bench('stars 1')
    bench.until(lambda: bench.commands)
    bench.pending = None
    bench.stamp = bench.commands[0].end + 50 * SECOND
    for _ in range(2):
        bench.read(bench.stamp, np.array([3.0, 0.8]))
        bench.stamp += SECOND
    bench.until(lambda: len(bench.commands) > 1)
    alarm, = bench.instruments.health.alarms
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


def test_stars_that_are_lost_count_over_all_steps():
    bench = Bench('stars 1, stars 1')
    bench.miss = lambda number: (np.nan, np.nan)
    bench.run()
    assert bench.plan.progress.lost == 2


def test_a_check_is_blind_and_summed_up():
    bench = Bench('check 3')
    bench.miss = lambda number: (np.nan, np.nan) if number in (1, 2, 3) else (
        150.0 * ARCSEC, -60.0 * ARCSEC)
    bench.run()
    assert len(bench.commands) == 5  # no centring, three blanks
    ((check,),) = bench.checks
    assert (check['block'], check['stars'], check['lost']) == (0, 2, 1)
    assert check['rms_arcsec'] == pytest.approx(np.hypot(150.0, 60.0), abs=1e-6)
    assert [row['check'][0] for row in bench.rows] == [1.0, 1.0]


def test_a_check_does_not_profit_from_the_stars_before():
    bench = Bench('stars 1, check 1')
    bench.miss = lambda number: (40.0 * ARCSEC, 40.0 * ARCSEC)
    bench.run()
    row, track = bench.rows[1], bench.commands[1]
    assert (track.angles[1, 1] - row['el'][0]) / ARCSEC == pytest.approx(0.0, abs=0.1)


def test_a_blind_star_gets_what_the_counts_had_wandered_at_the_one_before():
    follows = Following({'el': AxisFollowing(np.zeros(4), {1: 2.0 * ARCSEC})})
    bench = Bench('check 3')
    bench.in_force.take_model(PointingModel({'IA': 0.0}, provenance={
        KEY: follows.document(),
        'zeros_in_force': [{'run': 1, 'az_arcsec': 0.0, 'el_arcsec': 0.0}]}).to_json())
    bench.in_force.take_zero(START, RunZero(0.0, 0.0, run=1))

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
    assert bench.plan.text == 'the mount to come on target'
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


# --- power --------------------------------------------------------------------------------------


def test_a_zero_that_is_lost_is_looked_for_again_by_a_plan_that_homes():
    bench = Bench('home, stars 4')
    bench.homes()

    def miss(number):
        if number == 2 and bench.calls == ['home']:
            bench.error = np.full(2, np.nan)  # the power fails
        return 0.0, 0.0
    bench.miss = miss
    assert bench.run() == ('done', 'plan finished')
    assert bench.calls == ['home', 'home']
    runs = [row['run'][0] for row in bench.rows]
    assert len(runs) == 4 and sorted(set(runs)) == [1.0, 2.0] and runs == sorted(runs)


def test_a_plan_without_home_waits_for_somebody_else_to_home():
    bench = Bench('stars 1', homed=False)
    bench.waits('the encoder to be homed (call home)')
    assert bench.commands == [] and bench.calls == []
    bench.read(START + SECOND, bench.position)
    assert bench.run() == ('done', 'plan finished')


def test_power_off_and_on_is_a_new_run():
    bench = Bench('home, polaris 1, power_cycle, home, polaris 1', homed=False)

    def power_cycle():
        bench.error = np.full(2, np.nan)
        bench.read(bench.stamp + SECOND, bench.position)
    bench.homes()
    bench.offers('power_cycle', power_cycle)
    assert bench.run() == ('done', 'plan finished')
    assert bench.calls == ['home', 'power_cycle', 'home']
    assert [row['run'][0] for row in bench.rows] == [1.0, 2.0]
    # what an effect of the model may remember ends with the power-on
    assert bench.table.last_of(2) is bench.table.rows[-1] and bench.table.last_of(1) is None


@pytest.mark.parametrize('what, services', [
    ('absolute', ['absolute/power_cycle']), ('both', ['power_cycle', 'absolute/power_cycle'])])
def test_the_encoders_are_switched_apart_or_together(what, services):
    bench = Bench(f'power_cycle {what}')
    for service in services:
        bench.offers(service)
    assert bench.run() == ('done', 'plan finished')
    assert bench.calls == services
    # only the counter of the incremental encoder is lost with the power
    assert bench.instruments.homed == (what == 'absolute')


def test_an_encoder_that_missed_its_crossing_is_homed_again():
    bench = Bench('home', homed=False)
    bench.offers('home')  # it says that it was done, and no reading says so
    bench.until(lambda: len(bench.calls) == 2)
    assert bench.plan.text.startswith('the encoder to be homed') and bench.wall >= 1005.0
    bench.homes()
    assert bench.run() == ('done', 'plan finished')


def test_homing_lasts_until_the_axes_stand_still():
    bench = Bench('home', homed=False)
    bench.offers('home')
    bench.until(lambda: bench.calls == ['home'])
    bench.instruments.take_incremental(START + SECOND, (3.0, 0.8), (0.5 * DEG, 0.0))
    bench.plan.advance()
    assert bench.plan.busy and bench.calls == ['home']
    bench.instruments.take_incremental(START + 2 * SECOND, (3.0, 0.8), (0.0, 0.0))
    bench.plan.advance()
    assert not bench.plan.busy and bench.calls == ['home']


# --- Polaris, satellites, evenings --------------------------------------------------------------


def test_polaris_missing_ends_the_plan_before_the_zero():
    bench = Bench('polaris 2, calibrate_zero')
    bench.offers('calibrate_zero')
    bench.miss = lambda number: (np.nan, np.nan)
    assert bench.run() == (
        'failed', 'none of 2 exposures shows Polaris: look at sky, site and time')
    assert bench.calls == [] and bench.rows == []


def test_polaris_too_low_is_told_before_anything_is_observed():
    bench = Bench('stars 3, polaris 1')
    bench.site = Site(-30.0 * DEG, 0.0, 0.0)
    state, text = bench.run()
    assert state == 'failed' and text.startswith('Polaris stands at -')
    assert 'below min_elevation_deg = 20.0: set the zero another way' in text
    assert bench.commands == []


@pytest.mark.parametrize('plan', ['wait 24, polaris 1', 'wait 1', 'home, wait 24, polaris 1'])
def test_a_plan_may_wait_before_anything_else(plan):
    bench = Bench(plan)
    bench.homes()
    assert bench.run() == ('done', 'plan finished')
    first = bench.commands[0]
    hours = int(plan.split('wait ')[1].split(',')[0])
    assert first.start == START + hours * 3600 * SECOND
    np.testing.assert_array_equal(first.angles, np.tile(first.angles[0], (len(first.angles), 1)))
    np.testing.assert_allclose(first.angles[0], [3.0, 0.8], rtol=0, atol=1e-15)


def test_evenings_are_counted_from_the_evening_before_and_stars_come_again():
    bench = Bench('stars 5, wait 24, wait 24, stars 5')
    bench.run()
    starts = np.array([track.start for track in bench.commands])
    assert starts[5] == START + 24 * 3600 * SECOND and starts[6] == START + 48 * 3600 * SECOND
    # what was observed the evening before does not keep a star from being chosen
    assert bench.table.stars_since(int(starts[6])) == {
        int(row['star'][0]) for row in bench.rows[5:]}


def test_a_satellite_needs_its_elements_and_its_height():
    assert Bench('home, satellite 3').run() == (
        'failed', 'the plan has a step satellite: set the parameter satellite')
    state, text = Bench('satellite 3', satellite='gps-26690', min_elevation_deg=84.9).run()
    assert state == 'failed' and text.startswith('satellite 26690 stands at')


def test_a_satellite_is_exposed_at_its_interval():
    bench = Bench('satellite 3', satellite='gps-26690')
    bench.site = Site(0.0, 60.0 * DEG, 0.0)
    assert bench.run() == ('done', 'plan finished')
    np.testing.assert_array_equal(
        np.diff([track.start for track in bench.commands]), 90 * SECOND)


def test_no_star_that_fits_ends_the_plan():
    state, text = Bench('stars 5', min_elevation_deg=84.5, magnitude_limit=-1.0).run()
    assert state == 'failed' and text.startswith('no star visible')


# --- the calibration ----------------------------------------------------------------------------


def test_a_refused_service_ends_the_plan_with_its_reason_and_another_can_begin():
    bench = Bench('fit, stars 1')
    bench.offers('fit', answer=(False, 'too few stars'))
    assert bench.run() == ('failed', 'fit: too few stars')
    assert bench.statuses[-1][0].state == 'failed' and bench.rows == []
    bench.plan.start('stars 1')
    with pytest.raises(RuntimeError, match='under way'):
        bench.plan.start('stars 1')
    assert bench.run() == ('done', 'plan finished')
    assert len(bench.rows) == 1


def test_a_service_that_is_not_there_is_waited_for():
    bench = Bench('power_cycle').waits('a server of /mount/power_cycle')
    bench.offers('power_cycle')
    assert bench.run() == ('done', 'plan finished')


def test_the_zero_is_asked_for_when_every_row_was_taken_and_awaited():
    bench = Bench('polaris 2, calibrate_zero')
    bench.offers('calibrate_zero')
    bench.waits('calibration to take the last observation')
    bench.plan.calibration_has(1)
    assert bench.calls == []
    bench.calibrates()
    bench.waits('the new zero')
    bench.takes_zero(bench.table.newest - 1, 0.0, 0.0)  # of before
    assert bench.plan.busy
    bench.takes_zero(bench.table.newest, 0.0, 0.0)
    assert bench.plan.text == 'plan finished'


@pytest.mark.parametrize('verb', ['fit', 'diagnose', 'judge'])
def test_a_new_model_is_awaited_with_its_own_zero(verb):
    bench = Bench(f'polaris 1, {verb}')
    bench.offers(verb)
    bench.until(lambda: len(bench.rows) == 1)
    bench.calibrates()
    bench.waits('the new model')
    bench.takes_model(bench.table.newest - 1)
    assert bench.plan.text == 'the new model'
    bench.takes_model(bench.table.newest, [{'run': 1, 'az_arcsec': 20.0, 'el_arcsec': -9.0}])
    assert bench.plan.text == 'the zero of the new model'
    bench.takes_zero(bench.table.newest, 19.0 * ARCSEC, -9.0 * ARCSEC)
    assert bench.plan.busy
    bench.takes_zero(bench.table.newest, 20.0 * ARCSEC, -9.0 * ARCSEC)
    assert bench.plan.text == 'plan finished'


def test_a_model_of_before_is_no_new_one():
    bench = Bench('polaris 1, fit, fit')
    bench.offers('fit')
    bench.until(lambda: len(bench.rows) == 1)
    bench.calibrates()
    bench.waits('the new model')
    bench.takes_model(bench.table.newest)
    # the second one rests on the same rows
    bench.waits('the new model')
    assert bench.calls == ['fit', 'fit']
    bench.takes_model(bench.table.newest)
    assert bench.plan.text == 'plan finished'


def test_a_calibration_that_was_started_anew_gets_the_table_again():
    bench = Bench('stars 2, fit')
    bench.waits('calibration to take the last observation')
    assert [len(table) for table in bench.tables] == [2]
    bench.plan.calibration_has(1)
    assert len(bench.tables) == 1
    bench.plan.calibration_has(0)
    assert [len(table) for table in bench.tables] == [2, 2]


# --- started anew in the middle of a night --------------------------------------------------------


def after_a_crash(bench, plan=None):
    """A bench whose sequencer knows what the calibration gives back of `bench`'s."""
    again = Bench(homed=False)
    again.stamp, again.position = bench.stamp, bench.position
    again.services, again.calls = bench.services, bench.calls
    rows, left = bench.table.all(again=True), bench.plan.progress
    again.lacks = ['the rows']
    again.plan.start(plan or left.plan)
    again.tick()
    again.plan.take_up(rows, bench.table.newest, left)
    again.lacks = []
    again.read(again.stamp + SECOND, again.position)
    return again


def test_a_plan_goes_on_where_it_stood():
    plan = 'home, stars 4, polaris 3, fit'
    bench = Bench(plan)
    bench.homes()
    bench.until(lambda: len(bench.rows) == 6)
    again = after_a_crash(bench)
    again.offers('fit')
    again.waits('calibration to take the last observation')
    assert [row['block'][0] for row in again.rows] == [2.0]  # one more of Polaris
    assert again.table.newest > bench.table.newest
    assert len(again.tables[-1]) == 7 and again.calls == ['home']
    again.plan.calibration_has(7)
    again.waits('the new model')
    assert [row['star'] for row in again.table.rows[:6]] == [row['star'][0] for row in bench.rows]


def test_stars_that_were_observed_before_are_not_observed_again():
    bench = Bench('stars 8')
    bench.until(lambda: len(bench.rows) == 5)
    again = after_a_crash(bench)
    assert again.run() == ('done', 'plan finished')
    assert len(again.rows) == 3
    assert len({row['star'] for row in again.table.rows}) == 8


def test_blind_checks_of_the_same_plan_once_more_are_checks_of_their_own():
    bench = Bench('check 2')
    bench.run()
    bench.miss = lambda number: np.array([3.0, 4.0]) * ARCSEC
    bench.plan.start('check 2')
    bench.run()
    first, second = bench.checks[-1]
    assert (first['stars'], second['stars']) == (2, 2)
    assert second['rms_arcsec'] == pytest.approx(5.0)


def test_another_plan_begins_at_its_start_and_keeps_the_rows():
    bench = Bench('stars 3')
    bench.until(lambda: len(bench.rows) == 2)
    again = after_a_crash(bench, plan='polaris 2')
    assert again.run() == ('done', 'plan finished')
    assert [int(row['star']) == POLARIS_HIP for row in again.table.rows] == [
        False, False, True, True]
    assert again.plan.progress.observations == 4


def test_blind_checks_go_on_and_are_summed_up_over_both_parts():
    bench = Bench('check 2, check 3')
    bench.miss = lambda number: np.array([3.0, 4.0]) * ARCSEC
    bench.until(lambda: len(bench.rows) == 4)
    again = after_a_crash(bench)
    again.miss = bench.miss
    assert again.run() == ('done', 'plan finished')
    first, second = again.checks[-1]
    assert (first['block'], first['stars'], second['block'], second['stars']) == (0, 2, 1, 3)
    assert second['rms_arcsec'] == pytest.approx(5.0)


# --- the begin ----------------------------------------------------------------------------------


def test_it_begins_when_the_graph_is_there_and_the_clock_goes():
    bench = Bench()
    bench.lacks = ['a subscriber of /mount/command']
    bench.stamp = 0
    bench.plan.start('stars 1')
    bench.waits('the graph')
    bench.lacks = []
    bench.tick()
    assert bench.commands == [] and bench.plan.earth == ''
    bench.stamp = START
    assert bench.run() == ('done', 'plan finished')
    assert bench.plan.earth


def test_a_status_is_told_once():
    bench = Bench('stars 2')
    bench.run()
    assert all(one != other for one, other in zip(bench.statuses, bench.statuses[1:]))
    bench.plan.advance()
    assert bench.statuses[-1][1] == 'plan finished'
