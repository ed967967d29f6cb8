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

"""The plan on instruments and a clock of the test, without ROS."""


import numpy as np
import pytest
from bench import EXPOSURE, SECOND, START, Bench, offset

from msg_tools.status_rows import Taken
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.runs.run import first_of_last
from pointing_model.sky.places import observed_place
from pointing_model.sky.refraction import DEFAULT_WEATHER
from pointing_model.sky.site import DEFAULT_SITE, Site
from pointing_model.sky.star_catalogue import POLARIS_HIP, load_catalogue

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
    assert bench.table.last_of(2)['stamp'] == bench.table.newest
    assert bench.table.last_of(1) is None


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
    assert 'below min_elevation_deg = 20.0: set the zero on stars' in text
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
    bench.plan.calibration_has(Taken(1))
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
    bench.plan.calibration_has(Taken(1))
    assert len(bench.tables) == 1
    bench.plan.calibration_has(Taken(0))
    assert [len(table) for table in bench.tables] == [2, 2]


class Months(Bench):
    """So many power-ons, two rows and a fit in each, and a calibration that keeps the rows of some.

    Parameters
    ----------
    kept : int
        Power-ons, by the calibration; `power_ons` by the observer.
    late : int
        Ticks until the calibration has a row.
    """

    def __init__(self, count, kept, late=0, **options):
        self.kept, self.late, self.fits = kept, late, []
        self.made, self.sent = [], []  # power-on and stamp of each row; what of them, by tick
        super().__init__(', power_cycle, '.join(['home, polaris 2, fit'] * count), **options)
        self.homes()
        self.offers('power_cycle', self.power_cycle)
        self.offers('fit', lambda: self.fits.append(len(self.taken) == len(self.rows)))

    def send_row(self, run, stamp):
        super().send_row(run, stamp)
        self.made.append((run['run'][0], stamp))

    @property
    def taken(self):
        return self.sent[-1 - self.late] if len(self.sent) > self.late else []

    def power_cycle(self):
        self.error = np.full(2, np.nan)
        self.read(self.stamp + SECOND, self.position)

    def tick(self):
        super().tick()
        self.sent.append(list(self.made))
        runs = [run for run, _ in self.taken]
        forgotten = first_of_last(runs, self.kept)
        self.plan.calibration_has(Taken(
            len(runs) - forgotten, self.kept, forgotten,
            self.taken[-1][1] if runs else 0))
        if self.plan.text == 'the new model':
            self.takes_model(self.table.newest, [{'run': 1, 'az_arcsec': 0.0, 'el_arcsec': 0.0}])
            self.takes_zero(self.table.newest, 0.0, 0.0)


@pytest.mark.parametrize('late', [0, 1, 3])
@pytest.mark.parametrize(('observer', 'calibration'), [(0, 0), (2, 2), (2, 3), (3, 2), (0, 2),
                                                       (2, 0)])
def test_months_end_whatever_observer_and_calibration_keep(observer, calibration, late):
    bench = Months(5, calibration, late, power_ons=observer)
    assert bench.run() == ('done', 'plan finished')
    assert bench.fits == 5 * [True] and len(bench.rows) == 10
    progress = bench.statuses[-1][0]
    assert (progress.observations, progress.forgotten) == (10, {0: 0, 2: 6, 3: 4}[observer])
    assert max(map(len, bench.tables)) == (2 * observer or 10)


@pytest.mark.parametrize('late', [0, 1, 3])
def test_rows_that_both_forget_are_no_calibration_that_was_started_anew(late):
    bench = Months(5, 2, late, power_ons=2)
    bench.run()
    # one at the end of the step that has made rows
    assert len(bench.tables) == 5


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
    again.plan.calibration_has(Taken(7))
    again.waits('the new model')
    assert [row['star'] for row in again.table.rows[:6]] == [row['star'][0] for row in bench.rows]


def test_a_plan_of_months_goes_on_with_the_rows_that_are_kept():
    bench = Months(5, 2, power_ons=2)
    bench.until(lambda: len(bench.rows) == 7)
    again = after_a_crash(bench)
    assert [len(again.table), again.table.forgotten] == [7, 4]
    again.plan.calibration_has(Taken(3, 2, 4))
    again.until(lambda: len(again.rows) == 1)
    assert again.rows[0]['block'] == bench.rows[-1]['block']
    assert len(again.table) == 8 and again.plan.progress.observations == 8


def test_rows_that_turn_up_when_the_plan_has_begun_are_taken_before_a_row_is_made():
    plan = 'home, stars 4'
    bench = Bench(plan)
    bench.homes()
    bench.until(lambda: len(bench.rows) == 3)
    again = Bench(plan)
    again.homes()
    again.until(lambda: len(again.commands) == 1)
    again.lacks = ['the rows']
    again.plan.rows_turned_up()
    again.waits('the graph')
    again.plan.take_up(bench.table.all(again=True), bench.table.newest, bench.plan.progress)
    again.lacks = []
    again.read(bench.stamp + SECOND, again.position)
    assert again.run() == ('done', 'plan finished')
    assert len(again.rows) == 1 and len({row['star'] for row in again.table.rows}) == 4
    # with rows of its own, and when it is over, a plan is as it was
    bench.plan.rows_turned_up()
    assert bench.run() == ('done', 'plan finished') and len(bench.table) == 4
    bench.plan.rows_turned_up()
    assert not bench.plan.busy


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


def test_targets_that_the_guard_refuses_are_left_out_and_five_end_the_plan():
    bench = Bench('stars 8')
    bench.no = 'the track comes below the horizon'
    state, text = bench.run()
    assert state == 'failed' and len(bench.commands) == 5
    assert text == '5 targets in a row were refused: the track comes below the horizon'


def test_a_plan_that_is_held_up_goes_on_and_one_that_is_cancelled_ends():
    bench = Bench('stars 3')
    bench.hold = 'paused: call resume'
    bench.waits('the guard (paused: call resume)')
    assert not bench.commands
    bench.hold = ''
    bench.until(lambda: len(bench.rows) == 1)
    assert bench.plan.cancel('by hand') and not bench.plan.busy
    assert bench.statuses[-1][0].state == 'cancelled' and bench.statuses[-1][1] == 'by hand'
    assert not bench.plan.cancel('again')


def test_a_mount_that_must_not_move_is_not_homed():
    bench = Bench('home', homed=False)
    bench.services['home'] = lambda: bench.read(bench.stamp + SECOND, bench.position) or (True, '')
    bench.hold = 'mount_guard is unconfigured: configure it'
    bench.waits('the guard (mount_guard is unconfigured: configure it)')
    assert bench.calls == []
    bench.hold = ''
    bench.plan.advance()
    assert bench.calls == ['home']


def test_a_plan_that_is_taken_up_again_in_a_simulated_night_homes_for_a_first_reading():
    bench = Bench('stars 1', homed=False)
    bench.homes()
    bench.plan.night.homes = True
    assert bench.run() == ('done', 'plan finished')
    assert bench.calls == ['home']


def test_a_plan_that_is_taken_up_again_waits_for_the_first_reading_and_homes_nothing():
    bench = Bench('stars 1', homed=False, live=True)
    bench.services['home'] = lambda: (True, '')
    bench.plan.night.homes = True
    bench.waits('the first reading of the encoder')
    assert bench.calls == []
    bench.read(bench.stamp, bench.position)
    bench.plan.advance()
    assert bench.calls == [] and bench.commands
