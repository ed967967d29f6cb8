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

"""A night with an undeclared effect, one whose counts wander and a measured one, in the graph.

The effect is on a German mount in the south, which goes every step the long way; what is found on
altazimuth mounts `close-the-loop --scenario all` shows (docs/closing_the_loop.md).
"""

import json
from importlib import resources

import numpy as np
import pytest

from encoder_sim import scenario_file
from msg_tools.bag import BagReader
from msg_tools.units import ARCSEC
from pointing_model.model import PointingModel
from pointing_model.mounts import is_beyond
from pointing_model.runs.run_reader import read_run
from pointing_model.zero import Zeros
from telescope_mount.closed_loop.closed_loop import _site_of, close_the_loop, drive_error, loop_plan
from telescope_mount.closed_loop.loop_outcome import outcome, paired, points_worse
from telescope_mount.closed_loop.loop_tables import all_table, loop_sentences
from telescope_mount.input_files.run_loader import load_run
from telescope_mount.log_check.log_replay import _has_exposures
from telescope_mount.observing.plan import parse_plan
from telescope_mount.simulation import scenario_names, undeclared

MMT = resources.files('calibration') / 'data' / 'mmt_2021-08-21.csv'
LOOPS = [name for name in scenario_names() if name.startswith('loop_')]


def said_by(scenario):
    return scenario_file.undeclared(scenario_file.scenario_files(scenario)[0]['text'])


class Loop:
    """The folder of a loop and what it printed."""

    def __init__(self, cli, folder, *args):
        self.folder = folder
        done = cli('close-the-loop', '--out', folder, *args, '--verbose')
        assert done.returncode == 0, (done.stdout, done.stderr)
        assert done.stderr == ''
        self.text = done.stdout
        self.report = json.loads((folder / 'report.json').read_text())
        self.diagnosis = json.loads((folder / 'diagnosis.json').read_text())
        self.model = PointingModel.from_json((folder / 'model.json').read_text())


SMALL = ('--stars', 36, '--polaris', 4, '--check', 12)


@pytest.fixture(scope='module')
def german(cli, tmp_path_factory):
    """A loop with a counterweight that nobody was told of."""
    return Loop(cli, tmp_path_factory.mktemp('loop') / 'out', '--scenario', 'german_counterweight',
                '--latitude', -30, '--stars', 32, '--polaris', 4, '--check', 10, '--seed', 4)


@pytest.fixture(scope='module')
def mmt(cli, tmp_path_factory):
    return Loop(cli, tmp_path_factory.mktemp('loop') / 'out', MMT,
                '--latitude', 31.6888, '--longitude', -110.8846)


# --- an effect that nobody was told of ----------------------------------------------------------


def test_it_is_found_and_fresh_stars_gain(german):
    report = german.report
    assert report['mount'] == 'german' and report['mount_axes'] == ['hour angle', 'declination']
    assert report['verdict'] == 'identified' and report['found'] == 'yes'
    assert report['applied'] == ['MA_by_counterweight'] and report['false'] == []
    value, = report['effects'][0]['coefficients_arcsec'].values()
    assert value == pytest.approx(15.0, abs=1.5)
    before, after = report['blind_before'], report['blind_after']
    assert before['stars'] + before['lost'] == after['stars'] + after['lost'] == 10
    assert before['rms_y_arcsec'] > 3.0
    # no more than noise of 1.4 and what 32 stars leave, in 10 stars
    assert after['rms_arcsec'] < 2.4 < before['rms_arcsec']
    assert 1.0 < report['noise_floor_arcsec'] < 1.9


def test_both_sides_of_the_pier_are_one_model(german):
    run = read_run(german.folder / 'observations.csv')
    beyond = is_beyond(run['el'])
    assert run.mount.two_sided and 8 < beyond.sum() < len(run) - 8
    assert run.mount.agrees(german.model.mount)
    assert list(german.model.terms) == ['IH', 'ID', 'CH', 'NP', 'MA', 'ME', 'TF']
    # Polaris is below the horizon: the zero is by stars
    zeros, said = ([message.data for message in BagReader(german.folder / 'bag').messages(
        f'/mount/{name}', decode=True)] for name in ('zero', 'zero/identity'))
    assert {row.key: row.value for row in said[0].status[0].values}['by'] == 'stars'
    assert list(zeros[0].name) == ['hour_angle', 'declination']


def test_the_rows_of_a_check_are_blind_and_marked(german):
    rows = read_run(german.folder / 'observations.csv')
    checks = rows.select(rows['check'] == 1.0)
    blocks = np.unique(checks['block'])
    assert len(checks) == 20 and len(blocks) == 2
    for block, key in zip(blocks, ('blind_before', 'blind_after')):
        part = checks.select(checks['block'] == block)
        radial = np.sqrt(np.mean(part['miss_x'] ** 2 + part['miss_y'] ** 2)) / ARCSEC
        # the file has ten thousandths of an arcsec
        assert radial == pytest.approx(german.report[key]['rms_arcsec'], abs=1e-4)
    fresh = rows['star'][rows['block'] != 2.0]  # those of the zero are seen several times
    assert len(np.unique(fresh)) == len(fresh) == 32 + 20
    # what a pointing error is does not depend on how it is asked: the model of then missed by
    # what it says of the readings, but for where the axes stood off their demand
    old = PointingModel.from_json(next(
        BagReader(german.folder / 'bag').messages('/mount/model', decode=True)).data.data)
    first = checks.select(checks['block'] == blocks[0])
    zero = Zeros.from_list(old.provenance['zeros_in_force']).newest
    x, y = old.residuals(first, zero=zero)
    np.testing.assert_allclose(
        [x / ARCSEC, y / ARCSEC], [first['miss_x'] / ARCSEC, first['miss_y'] / ARCSEC], atol=0.5)


def test_a_log_read_as_a_run_leaves_the_judges_out(german):
    run = load_run(german.folder / 'bag')
    assert len(run) == 32
    assert any('20 rows excluded that are for validation' in n for n in run.meta['notes'])


def test_the_diagnosis_is_logged_and_nobody_was_told(german):
    names = [message.topic for message in BagReader(german.folder / 'bag').messages()]
    assert names.count('/mount/diagnosis') == 2  # and what fresh stars say of it
    assert names.count('/mount/observer/checks') == 2
    assert names.count('/mount/model') == names.count('/mount/calibration/report') == 3
    secret = german.report['undeclared']['what']
    assert undeclared(german.folder / 'bag_truth')['what'] == secret
    assert secret == said_by('german_counterweight')['what']
    for file in (german.folder / 'bag').iterdir():
        assert secret.encode() not in file.read_bytes()
    assert secret not in json.dumps(german.diagnosis)
    for name in ('star_observer', 'calibration', 'pointing_corrector', 'mcap_logger'):
        assert 'counterweight' not in (
            german.folder / 'nodes' / f'{name}.params.yaml').read_text()


def test_a_replay_finds_the_same(german, ended, tmp_path):
    out = tmp_path / 'model.json'
    code, said, err = ended('replay', german.folder / 'bag', '--save', out)
    assert code == 0, err
    assert 'identified: MA by counterweight' in said
    again = PointingModel.load(out)
    assert again.terms == german.model.terms
    np.testing.assert_array_equal(
        again.effects[0].coefficients, german.model.effects[0].coefficients)


def test_the_change_is_judged_before_and_after_it_is_published(german, ended):
    report = german.report
    assert report['published'] and report['refused'] == []
    assert report['judgement']['rows'] == 10 and report['judgement']['worse'] == []
    assert report['judged']['rows'] == 10 and not report['judged']['taken_back']
    assert report['judged']['why'] in ' '.join(german.text.split())
    assert german.model.provenance['judged'] == 'holds'
    code, *said = ended('verify', german.folder / 'bag')
    assert code == 0, said


def test_what_is_printed_and_written(german):
    for words in ('Verdict: identified', 'MA by counterweight', ' ha ', ' dec ',
                  'the same fresh stars, model before', 'noise floor', 'tilts 15"',
                  'found: yes', f'{german.report["blind_after"]["rms_arcsec"]:.2f}'):
        assert words in german.text, words
    assert 'azimuth' not in german.text
    page = (german.folder / 'diagnosis.html').read_text()
    assert page.startswith('<!DOCTYPE html') and 'hour angle' in page
    whole = (german.folder / 'page.html').read_text()
    before, after = (german.report['judged']['radial'][f'{when}_arcsec']
                     for when in ('before', 'after'))
    assert (f'. {after:.2f}″ RMS on fresh stars with the new model, {before:.2f}″ with the old'
            ) in whole
    # the pair of the same stars stands above those of other stars
    assert 0 < german.text.index('model before') < german.text.index('different stars')
    assert german.report['paired']['before']['rms_arcsec'] == before
    assert '<h2 class="part">Pointing diagnosis' in whole and whole.count('class="controls"') == 1
    for path in german.report['files'].values():
        assert path in german.text


# --- nothing to find, and counts that wander ------------------------------------------------------


def test_a_night_whose_counts_wander_points_by_the_absolute_encoder(cli, ended, tmp_path):
    # by a user's own file, which says what it does as those of the package do; so many counts
    # that a night of any order of stars, which differs from processor to processor, shows it
    told = {'what': 'nothing of the mount', 'shows_as': []}
    file = tmp_path / 'mine.yaml'
    file.write_text(f'based_on: wandering_counts\nundeclared: {json.dumps(told)}\n'
                    'incremental: {elevation: {miscounts: 300.0}}\n')
    loop = Loop(cli, tmp_path / 'out', '--scenario', file, *SMALL, '--seed', 3)
    report, follows = loop.report, loop.model.provenance['zero_follows']
    assert report['undeclared'] == told
    assert report['verdict'] == 'none' and report['found'] == 'rightly none'
    assert report['effects'] == []
    assert loop.model.effects == () and 'the model stays as it was' in loop.text
    assert list(follows) == ['elevation'] and loop.diagnosis['zero_follows'] == follows
    assert report['follows'] == ['elevation']
    assert 'zero of the elevation encoder: tracked by the absolute encoder' in loop.text
    # nothing was published: one model, and so one figure, though other stars were pointed at before
    assert report['paired']['before'] == report['paired']['after']
    assert report['paired']['after']['rms_arcsec'] == report['blind_after']['rms_arcsec']
    # the stars' noise of 1.4, what 36 stars leave and the way to the star, in 12 stars
    assert report['blind_after']['rms_arcsec'] < 2.6
    assert any('counts of the elevation encoder drift' in note for note in report['notes'])
    assert 'electromagnetic interference' in ' '.join(loop.text.split())
    # without following it is the walk itself that the blind stars are missed by
    rows = read_run(loop.folder / 'observations.csv')
    apart = (rows['el_enc'] - rows['el_abs'])[rows['check'] == 1.0] / ARCSEC
    reference = follows['elevation']['reference'][0]['difference_arcsec']
    assert np.sqrt(np.mean((apart - reference) ** 2)) > 1.2
    code, *said = ended('verify', loop.folder / 'bag')
    assert code == 0, said


# --- a measured night ---------------------------------------------------------------------------


def test_the_mmt_night_goes_through_the_same_graph(mmt):
    report = mmt.report
    assert report['source'] == str(MMT) and report['scenario'] is None
    assert report['kept_out'] == 20 and mmt.diagnosis['observations'] == 60
    assert report['verdict'] == 'ambiguous'
    names = {report['effects'][0]['name'], *report['effects'][0]['alternatives']}
    assert 'refraction_cube' in names  # what the reference places lack, see its README
    before, after = (report[key]['holdout_rms_arcsec'] for key in ('before', 'after'))
    assert after < 0.9 * before and after < 1.1
    assert mmt.diagnosis['site_deg'] == pytest.approx([31.6888, -110.8846])
    assert '60 of 60 rows used' in mmt.text
    assert (report['rows_read'], report['rows_used']) == (60, 60)
    assert 'rows kept out, after' in mmt.text and 'pointed blind' not in mmt.text
    assert report['paired']['of'] == 'rows kept out' and report['paired']['rows'] == 20
    assert (report['paired']['before']['rms_arcsec'],
            report['paired']['after']['rms_arcsec']) == (before, after)


def test_a_measured_night_is_logged_and_found_again(mmt, german, ended):
    bag = BagReader(mmt.folder / 'bag')
    assert bag.complete and bag.problems == []
    assert [m.topic for m in bag.messages()].count('/mount/observation') == 80
    code, *said = ended('verify', mmt.folder / 'bag')
    assert code == 0, said
    # a replay sets no zero where nothing was observed for one
    assert not _has_exposures(bag, '/mount/observation')
    assert _has_exposures(BagReader(german.folder / 'bag'), '/mount/observation')


# --- options and judgement ----------------------------------------------------------------------


def test_plan():
    steps = parse_plan(loop_plan(90, 16, 30))
    assert [step.verb for step in steps] == [
        'home', 'stars', 'zero', 'calibrate_zero', 'fit', 'check', 'diagnose', 'check',
        'judge']
    assert sum(step.exposures for step in steps) == 90 + 16 + 60


def test_every_scenario_says_what_it_does():
    assert len(LOOPS) >= 12
    for name in LOOPS:
        told = said_by(name)
        assert told['what'] and isinstance(told['shows_as'], list), name
        assert bool(told['shows_as']) == (name != 'loop_clean'), name
    assert said_by('default') is None


def effect(name, alternatives=(), aliases=()):
    return {'name': name, 'alternatives': list(alternatives), 'aliases': list(aliases)}


@pytest.mark.parametrize('shows_as, effects, wanted', [
    ([], [], ('rightly none', [])),
    ([], [effect('a')], ('wrong', ['a'])),
    (['a'], [], ('no', [])),
    (['a'], [effect('a_2')], ('yes', [])),
    (['a'], [effect('b', aliases=['a'])], ('yes', [])),
    (['a'], [effect('b', ['a'])], ('in the set', [])),
    (['a'], [effect('b'), effect('a')], ('yes', ['b'])),
    (['a', 'b'], [effect('a')], ('in part', [])),
    (['a', 'b'], [effect('c', ['a']), effect('b')], ('in the set', [])),
    (['a'], [effect('c')], ('no', ['c'])),
    (None, [effect('c')], (None, [])),
])
def test_outcome(shows_as, effects, wanted):
    assert outcome(shows_as, effects) == wanted


@pytest.mark.parametrize('verdict, wanted', [
    ('unknown', 'unknown'), ('identified', 'wrong'), ('ambiguous', 'wrong')])
def test_what_an_answer_is_worth_where_no_effect_is_the_right_one(verdict, wanted):
    assert outcome([], [effect('a')], verdict) == (wanted, ['a'])
    assert outcome([], [effect('a')], verdict, harmful=True) == ('harmful', ['a'])
    assert outcome(['a'], [effect('a')], verdict, harmful=True) == ('harmful', [])


@pytest.mark.parametrize('shows_as, effects, follows, wanted', [
    (['elevation_zero_with_time'], [], ['elevation'], ('followed', [])),
    (['elevation_zero_with_time'], [], ['azimuth'], ('no', [])),
    (['elevation_zero_step', 'a'], [effect('a')], ['elevation'], ('followed', [])),
    (['elevation_zero_step', 'a'], [], ['elevation'], ('in part', [])),
    (['elevation_zero_step'], [effect('elevation_zero_step')], ['elevation'], ('yes', [])),
    ([], [], ['elevation'], ('rightly none', [])),
])
def test_counts_that_are_followed_are_found(shows_as, effects, follows, wanted):
    assert outcome(shows_as, effects, 'none', follows=follows) == wanted


def test_before_and_after_are_of_the_same_stars():
    def blind(rms):
        return {'stars': 30, 'rms_arcsec': rms, 'rms_x_arcsec': 1.0, 'rms_y_arcsec': 1.0}
    figures = {f'{name}rms_arcsec': 1.0 for name in ('', 'cv_', 'holdout_')}
    # the night has become worse, and the change is for the better all the same
    report = {'blind_before': blind(5.06), 'blind_after': blind(5.46), 'published': True,
              'kept_out': 30, 'rows_used': 90, 'before': figures, 'after': figures, 'judged': {
                  'rows': 30, **{axis: {'before_arcsec': 6.65, 'after_arcsec': 5.46}
                                 for axis in ('radial', 'az', 'el')}}}

    def pair(**more):
        got = paired({**report, **more})
        return got['of'], *(got[when]['rms_arcsec'] for when in ('before', 'after'))
    assert pair() == ('fresh stars', 6.65, 5.46)
    assert pair(judged=None, published=False) == ('fresh stars', 5.46, 5.46)
    assert pair(judged=None) == ('rows kept out', 1.0, 1.0)
    lone = {**figures, 'holdout_rms_arcsec': None}
    assert pair(judged=None, after=lone)[0] == 'cross-validated rows'
    figures['rms_x_arcsec'] = figures['rms_y_arcsec'] = 0.7
    lone = {**figures, 'cv_rms_arcsec': None, 'holdout_rms_arcsec': None}
    assert pair(judged=None, after=lone) == ('rows fitted', 1.0, 1.0)


def test_worse_beyond_noise():
    def blind(rms, stars=30):
        return {'rms_arcsec': rms, 'stars': stars}
    assert points_worse(blind(1.0), blind(1.4)) and not points_worse(blind(1.0), blind(1.2))
    assert not points_worse(blind(1.0, 5), blind(1.4, 5))
    assert not points_worse(None, blind(9.0)) and not points_worse(blind(None, 0), blind(9.0))
    for same, worse in ((4.54, False), (5.4, True)):  # the wind has risen; the model is to blame
        judged = {'radial': {'before_arcsec': 4.5, 'after_arcsec': same}}
        assert points_worse(blind(3.0), blind(4.5), judged) == worse
    rng = np.random.default_rng(3)
    before, after = np.sqrt(np.mean(rng.normal(size=(2, 4000, 30, 2)) ** 2, axis=(2, 3)))
    assert np.mean([points_worse(blind(a), blind(b)) for a, b in zip(before, after)]) < 0.035


def test_how_far_the_axes_stood_from_their_demand(german):
    rows = read_run(german.folder / 'observations.csv')
    drive = german.report['drive']
    assert drive == pytest.approx(drive_error(rows, german.model), abs=1e-3)
    assert drive['stars'] == 10 and drive['rms_arcsec'] < 0.5
    assert drive['missed_arcsec'] == pytest.approx(german.report['blind_after']['rms_arcsec'])
    assert 'drive error' not in german.text
    # had the axes been elsewhere, encoders and camera would both have seen it
    late = rows['check'] == 1.0
    rows.columns['miss_y'] = rows['miss_y'] + 5.0 * ARCSEC * late
    more = drive_error(rows, german.model)
    assert more['rms_y_arcsec'] == pytest.approx(5.0, abs=0.3) and more['rms_x_arcsec'] < 0.5
    text = ' '.join(loop_sentences({**german.report, 'drive': more}))
    assert 'drive error by the encoders' in text and 'check servo' in text
    assert drive_error(rows.select(~late), german.model) is None


def test_the_site_of_a_measured_run():
    run = load_run(MMT)
    assert _site_of(run, {}) == ''
    assert _site_of(run, {'latitude_deg': 31.0}) == ''
    assert _site_of(run, {'latitude_deg': 31.0, 'longitude_deg': -110.0}) == '31.0, -110.0'
    run.meta['site'] = {'latitude': 0.5, 'longitude': None}
    assert _site_of(run, {'longitude_deg': -110.0}).endswith(', -110.0')
    run.meta['time_is_utc'] = False
    assert _site_of(run, {'latitude_deg': 31.0, 'longitude_deg': -110.0}) == ''
    assert close_the_loop.__kwdefaults__['alpha'] == 0.01


def test_bad_input_is_one_line(refused, tmp_path):
    assert 'required' in refused('close-the-loop')
    assert 'not allowed with' in refused('close-the-loop', MMT, '--scenario', 'x')
    assert 'absent.csv' in refused(
        'close-the-loop', tmp_path / 'absent.csv', '--out', tmp_path / 'b')
    (tmp_path / 'full').mkdir()
    (tmp_path / 'full' / 'file').write_text('')
    assert 'is not empty' in refused(
        'close-the-loop', '--scenario', 'loop_clean', '--out', tmp_path / 'full')
    assert '--alpha' in refused('close-the-loop', MMT, '--alpha', 3)
    for option in (('--equinox', 'date'), ('--pressure', 800), ('--azimuth-origin', 'S')):
        assert f'{option[0]} applies to measured runs' in refused(
            'close-the-loop', '--scenario', 'loop_clean', *option, '--out', tmp_path / 'c')
    # what places of a file are taken for reaches its reader, before a node starts
    assert '--equinox needs' in refused('close-the-loop', MMT, '--equinox', 'date', '--out',
                                            tmp_path / 'c')
    lines = [line.split(',') for line in MMT.read_text().splitlines()]
    for name in ('el_deg', 'el_enc_deg'):
        place = lines[0].index(name)
        for cells in lines[1:]:
            cells[place] = str(90.0 - float(cells[place]))
    (tmp_path / 'zenith.csv').write_text('\n'.join(map(','.join, lines)) + '\n')
    line = refused('close-the-loop', tmp_path / 'zenith.csv', '--out', tmp_path / 'd')
    assert 'zenith distance in place of the elevation of catalogue and encoders (1.' in line
    assert not (tmp_path / 'd').exists()


def test_a_step_that_cannot_be_carried_out_is_one_line(refused, ros_domain, tmp_path):
    (tmp_path / 'few.csv').write_text(
        'az_deg,el_deg,az_enc_deg,el_enc_deg\n10,50,10.01,50.01\n100,40,100.01,40.01\n')
    line = refused('close-the-loop', tmp_path / 'few.csv', '--out', tmp_path / 'c')
    assert 'fit: 1 usable observations do not determine 7 coefficients' in line
    assert 'observe at least 4 stars' in line and str(tmp_path / 'c' / 'bag') in line


def test_all_scenarios_in_one_table_and_one_that_failed_does_not_end_it(
        german, monkeypatch, tmp_path):
    import io

    from rich.console import Console

    from telescope_mount.closed_loop import closed_loop as module
    from telescope_mount.nights.whole_night import NightFailed
    asked, told = [], []

    def one(out, scenario, seed, progress):
        assert seed == 4
        asked.append((scenario, out))
        progress('stars', 1, 2)
        if scenario == 'loop_clean':
            raise NightFailed('the mount fell over')
        return {**german.report, 'scenario': scenario, 'false': ['x']}

    monkeypatch.setattr(module, 'close_the_loop', one)
    report = module.close_all(tmp_path / 'all', seed=4,  # by default those made for it
                              progress=lambda *args: told.append(args))
    assert asked == [(name, tmp_path / 'all' / name) for name in LOOPS]
    assert told[0] == (f'{LOOPS[0]}: stars', 1, 2)
    written = json.loads((tmp_path / 'all' / 'report.json').read_text())
    assert written == {key: report[key] for key in written} and report['incomplete'] == []
    out = io.StringIO()
    Console(file=out, width=200).print(all_table(report))
    lines = {line.split()[0]: line for line in out.getvalue().splitlines() if line.strip()}
    assert 'the mount fell over' in lines['loop_clean'] and 'alarms' not in out.getvalue()
    for words in ('identified', 'MA by counterweight', 'yes, 1 besides',
                  f'{german.report["judged"]["radial"]["before_arcsec"]:.2f}'):
        assert words in lines['loop_refraction']
    # a pattern, and the alarms of the encoder cross-check
    asked.clear()
    some = module.close_all(tmp_path / 'some', names='loop_*_backlash', seed=4,
                            progress=lambda *args: None)
    assert [name for name, _ in asked] == ['loop_azimuth_backlash', 'loop_elevation_backlash']
    some['scenarios'][1]['alarms'] = ['azimuth: incremental encoder jumped by +30 arcsec at noon']
    out = io.StringIO()
    Console(file=out, width=200).print(all_table(some))
    assert 'alarms' in out.getvalue()
    assert 'azimuth: incremental encoder' in out.getvalue() and 'at noon' not in out.getvalue()
    with pytest.raises(ValueError, match=r"no scenario 'x\*'; --scenario list prints"):
        module.close_all(tmp_path / 'none', names='x*', seed=4)
    assert not (tmp_path / 'none').exists()
