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

"""The command line: good input, and every kind of bad input with one line and code 2."""

import argparse
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from places import LOG, ROOT

from msg_tools.units import ARCSEC
from pointing_model.model import PointingModel
from pointing_model.pointing_terms import PHYSICAL
from pointing_model.runs.plate_solves import solvers
from pointing_model.runs.plate_solves.solvers import PROGRAMS
from pointing_model.runs.run import PointingRun
from pointing_model.sky.orbits.orbit_files import FORMATS
from pointing_model.sky.refraction import AIR
from pointing_model.sky.site import SITE
from telescope_mount.command_parser import COMMANDS, parsed
from telescope_mount.commands import fit, options
from telescope_mount.drivers import nudge
from telescope_mount.processes import domain

MOUNT = PointingModel(dict(zip(PHYSICAL, np.array([310, -170, 46, -23, 37, -21, 15]) * ARCSEC)))


@pytest.fixture
def run_csv(tmp_path):
    from pointing_model.runs.formats.csv import write_csv
    rng = np.random.default_rng(0)
    az, el = rng.uniform(0, 2 * np.pi, 60), rng.uniform(0.3, 1.4, 60)
    az_enc, el_enc = MOUNT.sky_to_encoder(az, el)
    x, y = rng.normal(size=(2, 60)) * ARCSEC
    path = tmp_path / 'run.csv'
    write_csv(PointingRun({'az': az, 'el': el, 'az_enc': az_enc + x / np.cos(el),
                           'el_enc': el_enc + y}), path)
    return path


# --- help and options ---------------------------------------------------------------------------


@pytest.mark.parametrize('words', [(), *((name.replace('_', '-'),) for name in COMMANDS)])
def test_help_is_help(ended, words):
    code, out, err = ended(*words, '--help')
    assert code == 0 and err == '' and 'usage: telescope-mount' in out
    if words:  # its example is a command line
        begin, _, found = out.splitlines()[-1].partition(' telescope-mount ')
        assert begin == 'Example:' and parsed(shlex.split(found)).command == words[0]


@pytest.mark.parametrize('words, names', [
    ('passes', [one.wording for one in FORMATS]), ('satellite', [one.wording for one in FORMATS]),
    ('night', [one.wording for one in FORMATS]), ('solve', PROGRAMS), ('bolts', PROGRAMS)])
def test_help_lists_what_is_registered(ended, words, names):
    assert ', '.join(names) in ' '.join(ended(words, '--help')[1].split()).replace('- ', '-')


def test_a_default_is_the_number_of_the_module_that_works_with_it(ended):
    assert parsed(['solve', 'images']).timeout == solvers.TIMEOUT
    assert parsed(['check-drivers', '--nudge']).nudge == nudge.STEP_DEG
    assert parsed(['check-drivers']).nudge == 0.0
    assert f'(default: {solvers.TIMEOUT:g})' in ended('solve', '--help')[1]


def test_help_imports_nothing_that_takes_time():
    code = ('import sys; from telescope_mount.cli import main\n'
            'try: main(["--help"])\n'
            'except SystemExit: print("LOADED", *sys.modules)')
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    loaded = {name.split('.')[0] for name in done.stdout.split('LOADED ')[1].split()}
    assert not loaded & {'numpy', 'scipy', 'rclpy', 'rich', 'matplotlib', 'yaml', 'erfa', 'mcap',
                         'zstandard'}


@pytest.mark.parametrize('words, text', [
    ((), 'COMMAND'),
    (('nihgt',), 'nihgt'),
    (('night', '--starz', '3'), '--starz'),
    (('night', '--stars', '3'), 'whole number, 4 to 5000'),
    (('night', '--stars', 'many'), 'whole number, 4 to 5000'),
    (('night', '--polaris', '1'), 'whole number, 2 to 5000'),
    (('night', '--latitude', '95'), 'must be a decimal number, -90 to 90 degrees'),
    (('night', '--latitude', 'nan'), 'must be a decimal number, -90 to 90 degrees'),
    (('night', '--height', '1e9'), 'must be a decimal number, -500 to 10000 m'),
    (('night', '--seed', '-1'), 'whole number'),
    (('night', '--domain', '102'), 'whole number, 0 to 101'),
    (('night', '--time-scale', '-1'), 'must be a decimal number, 0 to 1000'),
    (('night', '--mount', 'indi:'), 'is no INDI server; write indi:HOST or indi:HOST:PORT'),
    (('night', '--mount', 'indi:dome', '--scenario', 'german'), '--scenario applies to the'),
    (('night', '--mount', 'alpaca:a:b'), 'is no Alpaca server; write alpaca:HOST or alpaca:HOST:P'),
    (('night', '--mount', 'german'), 'scenario default has an alt-azimuth mount and not a German'),
    (('night', '--mount', 'altaz', '--scenario', 'fork'), 'give the mount equatorial, or a'),
    (('night', '--anew'), '--anew needs a mount of a server: give --mount indi:HOST:PORT'),
    (('night', '--mount', 'indi:dome', '--camera', 'CCD'), 'write indi:HOST:PORT:NAME'),
    (('fit',), 'RUN'),
    (('fit', 'x.csv', '--encoder', 'both'), 'both'),
    (('fit', 'x.csv', '--azimuth-origin', 'E'), "'E'"),
    (('diagnose', 'x.csv', '--alpha', '2'), 'argument --alpha'),
    (('fit', 'x.csv', '--harmonics', 'nadir'), "'nadir'"),
    (('replay', 'x', '--harmonics-degree', '5'), 'whole number, 0 to 4'),
    (('replay',), 'BAG'),
])
def test_bad_options_are_one_line(refused, monkeypatch, tmp_path, words, text):
    monkeypatch.chdir(tmp_path)  # a night beside it would be found
    assert text in refused(*words)


def test_help_names_all_solvers_and_orbit_formats():
    """They stand in the options once more, for the registries are slow to import."""
    assert ', '.join(PROGRAMS) == options.SOLVERS
    assert ', '.join(one.wording for one in FORMATS) == options.ORBITS


def test_options_of_a_site_have_its_ranges():
    # they are written out there, as a command that asks for none imports nothing
    for name, one in {**SITE, 'pressure_hpa': AIR['pressure_hpa'],
                      'temperature_c': AIR['temperature_c']}.items():
        read = options.SHARED[name.split('_')[0]]['type']
        assert [read(f'{value}') for value in (one.low, one.high)] == [one.low, one.high]
        for value in (one.low - 1.0, one.high + 1.0):
            with pytest.raises(argparse.ArgumentTypeError):
                read(f'{value}')


def test_git_ignores_what_is_written_by_default():
    from telescope_mount.command_parser import make_parser
    commands = next(a.choices for a in make_parser()._actions if a.dest == 'command')
    folders = [str(parser.get_default('out')) for parser in commands.values()
               if parser.get_default('out')]
    assert len(folders) == 5
    folders += ['night_bag', 'night_bag_truth', 'telescope_mount_log', 'bag', 'bag_recovered']
    root = ROOT
    if not (root / '.git').exists():
        pytest.skip('not a clone of the repository')
    done = subprocess.run(['git', 'check-ignore', *(f'{name}/' for name in folders)], cwd=root,
                          capture_output=True, text=True)
    if done.returncode > 1:
        pytest.skip('git cannot read the repository')
    assert done.stdout.split() == [f'{name}/' for name in folders]


# --- night --------------------------------------------------------------------------------------


def test_an_output_that_is_in_use(refused, tmp_path):
    (tmp_path / 'file').write_text('x')
    assert 'is not empty; choose another folder' in refused(
        'night', '--out', tmp_path)
    assert 'is a file' in refused('night', '--out', tmp_path / 'file')
    assert 'file' in refused('night', '--out', tmp_path / 'file' / 'under')
    assert sorted(p.name for p in tmp_path.iterdir()) == ['file']


def test_a_domain_in_use(refused, tmp_path):
    lock = domain.claim()
    try:
        assert f'domain {lock.number} is in use on this machine' in refused(
            'night', '--out', tmp_path / 'n', '--domain', lock.number)
    finally:
        lock.release()


def test_files_that_are_not_there(refused, tmp_path):
    assert 'is no file; give a ROS parameter file' in refused(
        'night', '--out', tmp_path / 'n', '--params', tmp_path / 'absent.yaml')
    assert 'absent.json' in refused(
        'night', '--out', tmp_path / 'n', '--reference', tmp_path / 'absent.json')
    (tmp_path / 'bad.json').write_text('{"format": "other"}')
    assert 'bad.json: not a pointing model' in refused(
        'night', '--out', tmp_path / 'n', '--reference', tmp_path / 'bad.json')


def test_what_the_user_chose_reaches_the_night(refused, monkeypatch, tmp_path):
    from telescope_mount.nights import whole_night as night
    (tmp_path / 'p.yaml').write_text('')
    asked, given = [], night.run_night

    def refuse(out, progress, **options):
        asked.append({'out': out, **options})
        raise ValueError('enough')
    monkeypatch.setattr(night, 'run_night', refuse)
    assert 'enough' in refused(
        'night', '--out', tmp_path / 'n', '--seed', 5, '--stars', 6, '--polaris', 7,
        '--scenario', 'ideal', '--reference', 'm.json', '--date', '2026-02-01', '--latitude', -40,
        '--longitude', 10, '--height', 2000, '--params', tmp_path / 'p.yaml', '--time-scale', 2,
        '--domain', 3, '--mount', 'german')
    assert 'enough' in refused('night')
    assert asked[0] == {
        'out': tmp_path / 'n', 'seed': 5, 'stars': 6, 'polaris': 7, 'scenario': 'ideal',
        'start_time': '2026-02-01', 'reference': Path('m.json'), 'domain_number': 3,
        'time_scale': 2.0, 'params_file': tmp_path / 'p.yaml', 'absolute': 'angles',
        'cycle': 'incremental', 'calibration': {}, 'mount': 'german',
        'track': '', 'discrimination': '',
        'sky': {'latitude_deg': -40.0, 'longitude_deg': 10.0, 'height_m': 2000.0}}
    assert 'enough' in refused('night', '--power-cycle', 'both')
    assert asked.pop()['cycle'] == 'both'
    assert 'leave one of them out' in refused(
        'night', '--power-cycle', 'both', '--reference', 'm.json')
    # what was not chosen is as of the functions themselves
    own, of_graph = given.__kwdefaults__, night.night_graph.__kwdefaults__
    assert set(own) - set(asked[1]) == {'progress'}
    for name in set(asked[1]) - {'out', 'sky', 'calibration'}:
        assert asked[1][name] == (own if name in own else of_graph)[name], name
    assert asked[1]['out'] == Path('night') and asked[1]['sky'] == asked[1]['calibration'] == {}


def test_what_a_parameter_file_makes_impossible(refused, ros_domain, tmp_path):
    path = tmp_path / 'params.yaml'
    path.write_text('/mount/star_observer:\n  ros__parameters:\n    min_elevation_dg: 30.0\n')
    line = refused('night', '--out', tmp_path / 'n', '--stars', 4, '--polaris', 2,
                   '--params', path)
    assert 'unknown parameter min_elevation_dg; did you mean min_elevation' in line


# --- fit ----------------------------------------------------------------------------------------


@pytest.mark.parametrize('option, name', [
    ('--save', 'model.yaml'), ('--report', 'page.html'), ('--json', 'fit.json')])
def test_a_full_disk_is_one_line_and_leaves_no_part_of_a_file(
        ended, run_csv, tmp_path, monkeypatch, nothing_expected, option, name):
    def full(file):
        raise OSError(28, 'No space left on device')
    monkeypatch.setattr('os.fsync', full)
    folder = tmp_path / 'out'
    folder.mkdir()
    code, _, err = ended('fit', run_csv, option, folder / name)
    assert (code, err) == (2, f'error: {folder / name}: No space left on device; free some, or '
                              'write elsewhere\n')
    assert list(folder.iterdir()) == []


def test_a_standard_output_that_is_full_is_one_line(cli, run_csv):
    with open('/dev/full', 'w') as full, cli.start('fit', run_csv, stdout=full) as child:
        err = child.communicate(timeout=300)[1]
    assert (child.returncode, err) == (
        2, 'error: No space left on device; free some, or write elsewhere\n')


def test_fit_prints_the_terms_and_saves_the_model(ended, run_csv, tmp_path):
    saved = tmp_path / 'model.json'
    code, out, err = ended('fit', run_csv, '--save', saved)
    assert (code, err) == (0, '')
    assert '60 rows' in out and str(saved) in out
    model = PointingModel.load(saved)
    for name in ('CA', 'NPAE', 'AN', 'AW', 'TF'):
        assert model.terms[name] / ARCSEC == pytest.approx(MOUNT.terms[name] / ARCSEC, abs=4.0)
        assert any(line.split()[:2] == [name, f'{model.terms[name] / ARCSEC:+.2f}']
                   for line in out.splitlines())


def test_fit_adds_harmonics_and_says_what_they_are_worth(ended, run_csv, tmp_path):
    saved = tmp_path / 'model.json'
    code, out, err = ended('fit', run_csv, '--harmonics', 'zenith', '--harmonics-degree', 2,
                           '--save', saved, '--verbose')
    assert (code, err) == (0, '')
    model = PointingModel.load(saved)
    assert model.harmonics.degree == 2 and len(model.terms) == 7
    assert model.provenance['source'] == str(run_csv)
    for name, (value, sigma) in model.harmonics.coefficients.items():
        assert any(words[i:i + 3] == [name, f'{value / ARCSEC:+.2f}', f'{sigma / ARCSEC:.2f}']
                   for words in map(str.split, out.splitlines()) for i in (0, 3))
    chosen = next(line for line in out.splitlines() if 'chosen by parameter' in line)
    assert chosen.strip().startswith('7 terms, then 7 harmonics, E read as zenith distance')
    assert 'cross-validation prefers another model: 7 terms' in ' '.join(out.split())
    code, out, _ = ended('fit', run_csv, '--harmonics', 'printed', '--harmonics-alone', '--save',
                         saved, '--overwrite', '--verbose')
    alone = PointingModel.load(saved)
    assert code == 0 and alone.terms == {} and alone.harmonics.interpretation == 'printed'
    assert 'chosen by cross-validation' in out


@pytest.mark.parametrize('options, words', [
    (['--harmonics-alone'], 'but no harmonics; take zenith or printed'),
    (['--harmonics-degree', 2], 'but no harmonics; take zenith or printed')])
@pytest.mark.parametrize('command', [('fit', 'no.csv'), ('night', '--out', 'no'),
                                     ('replay', 'no')])
def test_harmonics_that_cannot_be(refused, command, options, words):
    assert words in refused(*command, *options)


def test_too_few_rows_for_the_harmonics_are_one_line(refused, run_csv):
    from pointing_model.runs.formats.csv import write_csv
    from pointing_model.runs.run_reader import read_run
    write_csv(read_run(run_csv).select(slice(0, 10)), run_csv)
    line = refused('fit', run_csv, '--harmonics', 'zenith', '--harmonics-degree', 4)
    assert 'observe at least 14 stars' in line and 'or take a lower degree' in line


def test_fit_reads_the_log_of_a_night(night, ended):
    code, out, err = ended('fit', night / 'bag', '--verbose')
    assert code == 0, err
    assert '16 rows' in out
    assert '8 exposures of Polaris left out' in out
    assert 'fitted together' not in out
    code, out, err = ended('fit', night / 'observations.csv', '--encoder', 'abs')
    assert code == 0, err
    assert '2 runs (column run) fitted together' in out


def test_fit_takes_one_run_of_several(ended, refused, run_csv):
    from pointing_model.runs.formats.csv import write_csv
    from pointing_model.runs.run_reader import read_run
    run = read_run(run_csv)
    run.columns['run'] = np.repeat([1, 2], 30)
    run.columns['el_enc'] = run['el_enc'] + 300.0 * ARCSEC * (run['run'] == 2)
    write_csv(run, run_csv)
    _, out, _ = ended('fit', run_csv)
    assert '60 rows' in out and 'fitted together' in out
    _, out, _ = ended('fit', run_csv, '--run', 2)
    assert '30 rows' in out and 'fitted together' not in out
    assert 'no run 7 (there: 1, 2)' in refused('fit', run_csv, '--run', 7)


def test_fit_gives_sessions_zeros_of_their_own(ended, refused, run_csv):
    from pointing_model.runs.formats.csv import write_csv
    from pointing_model.runs.run_reader import read_run
    run = read_run(run_csv)
    run.columns['run'] = np.repeat([1, 2], 30)
    run.columns['el_enc'] = run['el_enc'] + 300.0 * ARCSEC * (run['run'] == 2)
    run.columns['time'] = 1.7e9 + 100.0 * np.arange(60)
    write_csv(run, run_csv)
    saved = run_csv.parent / 'm.json'
    code, out, err = ended('fit', run_csv, '--sessions', 'auto', '--save', saved)
    assert code == 0, err
    # one points by the newest zeros
    assert 'the model has the zeros of run 2, the newest' in ' '.join(out.split())
    model = PointingModel.load(saved)
    off = model.terms['IE'] / ARCSEC - (300.0 - 170.0)
    assert abs(off) < 4.0 * np.sqrt(model.covariance[1, 1]) / ARCSEC < 20.0
    noted = ' '.join(ended('diagnose', run_csv, '--save', run_csv.parent / 'd.json')[1].split())
    assert 'has the medians of 2 runs' in noted
    assert 'IE[2]' in out and '+300' in out and 'fitted together' not in out
    del run.columns['run']
    run.columns['time'][30:] += 5 * 3600.0
    write_csv(run, run_csv)
    assert 'IE[2]' in ended('fit', run_csv, '--sessions', 4)[1]
    assert 'IE[2]' not in ended('fit', run_csv, '--sessions', 'none')[1]
    assert 'hours, auto or none' in refused('fit', run_csv, '--sessions', 'soon')
    assert '--sessions changes nothing' in refused('fit', run_csv, '--predict', '--sessions', 3)


def test_fit_refuses_what_it_cannot_read(refused, run_csv, tmp_path):
    text = run_csv.read_text()
    bad = tmp_path / 'bad.csv'
    bad.write_text(text.replace('el_enc_deg', 'el_enc'))
    assert 'el_enc' in refused('fit', bad)
    lines = text.splitlines()
    number = next(i for i, line in enumerate(lines) if line[:1].isdigit()) + 3
    lines[number:] = ['x' + line for line in lines[number:]]
    bad.write_text('\n'.join(lines))
    assert f'row {number + 1}, column az_deg' in refused('fit', bad)
    bad.write_text('')
    refused('fit', bad)
    bad.write_bytes(bytes(range(256)) * 4)
    refused('fit', bad)
    assert 'absent.csv' in refused('fit', tmp_path / 'absent.csv')
    refused('fit', tmp_path)


def test_fit_refuses_what_it_cannot_do(refused, run_csv, tmp_path):
    assert 'XY' in refused('fit', run_csv, '--terms', 'IA,XY')
    assert 'name at least one' in refused('fit', run_csv, '--terms', ' , ')
    assert 'no second encoder; leave out --encoder abs' in refused(
        'fit', run_csv, '--encoder', 'abs')
    for target, words in (('model.txt', 'must end in .json'), ('no/model.json', 'no such folder')):
        assert words in refused('fit', run_csv, '--save', tmp_path / target)
    lines = run_csv.read_text().splitlines()
    start = next(i for i, line in enumerate(lines) if line[:1].isdigit())
    (tmp_path / 'few.csv').write_text('\n'.join(lines[:start + 3]))
    assert 'observe' in refused('fit', tmp_path / 'few.csv')


def test_fit_refuses_the_truth_and_a_log_cut_short(night, refused, tmp_path):
    pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)
    assert 'holds the truth of the simulator; give the log beside it' in refused(
        'fit', night / 'bag_truth')
    whole = next((night / 'bag').glob('*.mcap')).read_bytes()
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(whole[:200])
    assert 'observation' in refused('fit', cut)
    cut.write_bytes(b'')
    assert 'is empty' in refused('fit', cut)


# --- the end ------------------------------------------------------------------------------------


def test_ctrl_c_and_a_closed_pipe(ended, monkeypatch, run_csv):
    def stop(error):
        def run(args):
            raise error
        return run
    monkeypatch.setattr(fit, 'run', stop(KeyboardInterrupt()))
    code, _, err = ended('fit', run_csv)
    assert code == 130 and len(err.splitlines()) == 1
    # at any moment, also where no graph is watched
    for number, code in ((signal.SIGTERM, 143), (signal.SIGHUP, 129)):
        before = signal.getsignal(number)
        monkeypatch.setattr(fit, 'run', lambda args, number=number: signal.raise_signal(number))
        assert ended('fit', run_csv) == (code, '', f'ended by {number.name}\n')
        assert signal.getsignal(number) == before

    def imports(args):
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGTERM)
        raise ImportError('a C extension could not be imported')
    monkeypatch.setattr(fit, 'run', imports)
    assert ended('fit', run_csv)[0] == 143
    monkeypatch.setattr(fit, 'run', stop(BrokenPipeError()))
    assert ended('fit', run_csv)[::2] == (0, '')
    monkeypatch.setattr(fit, 'run', stop(OSError(28, 'No space left on device', 'model')))
    assert ended('fit', run_csv) == (2, '', 'error: model: No space left on device; '
                                    'free some, or write elsewhere\n')
    monkeypatch.setattr(fit, 'run', stop(ValueError('two\n  lines')))
    assert ended('fit', run_csv) == (2, '', 'error: two lines\n')
    monkeypatch.setattr(fit, 'run', stop(TypeError('a bug')))
    with pytest.raises(TypeError):
        ended('fit', run_csv)


@pytest.mark.parametrize('command', ['fit', 'diagnose', 'zeros'])
def test_an_unknown_option_points_to_the_help_of_its_command(refused, command):
    assert f'--bogus (see telescope-mount {command} --help)' in refused(command, '--bogus', 'x')


def test_a_folder_of_images_points_to_what_says_what_they_are(refused, tmp_path):
    (tmp_path / 'a.fits').touch()
    assert f'write {tmp_path / "mount.yaml"}' in refused('fit', tmp_path)
    (tmp_path / 'mount.yaml').touch()
    assert f'give {tmp_path / "mount.yaml"}' in refused('diagnose', tmp_path)


def test_an_option_means_one_thing_in_all_commands():
    """The same kind of value, the same choices; but --out may be a folder or a table."""
    from telescope_mount.command_parser import make_parser
    commands = next(a.choices for a in make_parser()._actions if a.dest == 'command')
    meanings = {}
    for name, parser in commands.items():
        for action in parser._actions:
            for option in action.option_strings:
                meanings.setdefault(option, {}).setdefault((
                    type(action), action.nargs, action.metavar,
                    action.choices and tuple(action.choices)), []).append(name)
    several = {option: kinds for option, kinds in meanings.items() if len(kinds) > 1}
    assert set(several) == {'--out'}
    assert {kind[2] for kind in several['--out']} == {'DIR', 'FILE', 'FILE.csv'}
    # what may be printed for programs may be, everywhere, and nothing named is overwritten
    assert set(commands) - set(sum(meanings['--json'].values(), [])) == {'apply', 'completion'}
    assert set(commands) - set(sum(meanings['--overwrite'].values(), [])) == {'completion'}


# --- what holds for all -------------------------------------------------------------------------


def test_the_version(ended):
    code, out, err = ended('--version')
    assert (code, err) == (0, '') and out.startswith('telescope-mount 0.')
    done = subprocess.run([sys.executable, '-m', 'telescope_mount', '--version'],
                          capture_output=True, text=True, check=True)
    assert done.stdout == out


def test_the_folder_of_a_night_stands_for_its_log(night, ended, tmp_path):
    for words in (('info', night), ('verify', night), ('fit', night),
                  ('export', night, tmp_path / 'run.csv'), ('recover', night, '--out',
                                                            tmp_path / 'whole')):
        code, out, err = ended(*words)
        assert (code, err) == (0, ''), (words, out, err)
    assert (tmp_path / 'run.csv').is_file() and (tmp_path / 'whole' / 'metadata.yaml').is_file()
    code, _, err = ended('apply', night, tmp_path / 'run.csv', '--out', tmp_path / 'angles.csv')
    assert code == 0 and 'note: ' in err
    (tmp_path / 'nights').mkdir()
    (tmp_path / 'nights' / 'first').symlink_to(night)
    code, _, err = ended('season', tmp_path / 'nights')
    assert code == 2 and 'a season takes three' in err


def test_a_damaged_log_is_told_by_the_code(ended, tmp_path):
    sample = LOG
    whole = next(sample.glob('*.mcap')).read_bytes()
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(whole[:len(whole) * 2 // 3])
    for words, told in ((('info', sample), 0), (('info', cut), 1), (('info', cut, '--quick'), 1),
                        (('verify', cut), 1), (('recover', cut), 1)):
        code, out, err = ended(*words)
        assert (code, err) == (told, ''), (words, out)
    assert ended('info', tmp_path / 'cut_recovered')[0] == 0


def test_scenarios_are_listed(ended):
    from telescope_mount.simulation import scenario_names
    out = ended('night', '--scenario', 'list')[1]
    assert all(name in out for name in scenario_names())
    out = ended('close-the-loop', '--scenario', 'list')[1]
    assert 'loop_clean' in out and 'mount_gusts' in out and 'season_none' not in out
