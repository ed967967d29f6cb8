"""The command line: good input, and every kind of bad input with one line and code 2."""

import numpy as np
import pytest

from msg_tools.units import ARCSEC
from pointing_model.model import PointingModel
from pointing_model.run import PointingRun
from pointing_model.terms import PHYSICAL
from telescope_mount import cli as module
from telescope_mount import domain

MOUNT = PointingModel(dict(zip(PHYSICAL, np.array([310, -170, 46, -23, 37, -21, 15]) * ARCSEC)))


def main(capsys, *args):
    """Run in this process: (code, stdout, stderr)."""
    try:
        code = module.main([str(arg) for arg in args])
    except SystemExit as end:
        code = end.code
    return code, *capsys.readouterr()


def one_line(capsys, *args):
    code, _, err = main(capsys, *args)
    assert code == 2
    assert len(err.splitlines()) == 1 and err.startswith('error: '), err
    return err


@pytest.fixture
def run_csv(tmp_path):
    from pointing_model.run_files import write_csv
    rng = np.random.default_rng(0)
    az, el = rng.uniform(0, 2 * np.pi, 60), rng.uniform(0.3, 1.4, 60)
    az_enc, el_enc = MOUNT.sky_to_encoder(az, el)
    x, y = rng.normal(size=(2, 60)) * ARCSEC
    path = tmp_path / 'run.csv'
    write_csv(PointingRun({'az': az, 'el': el, 'az_enc': az_enc + x / np.cos(el),
                           'el_enc': el_enc + y}), path)
    return path


# --- help and options ---------------------------------------------------------------------------


@pytest.mark.parametrize('words', [(), ('night',), ('fit',), ('replay',)])
def test_help_is_help(capsys, words):
    code, out, err = main(capsys, *words, '--help')
    assert code == 0 and err == '' and 'usage: telescope-mount' in out


@pytest.mark.parametrize('words, text', [
    ((), 'COMMAND'),
    (('nihgt',), 'nihgt'),
    (('night', '--starz', '3'), '--starz'),
    (('night', '--stars', '3'), 'whole number, 4 to 5000'),
    (('night', '--stars', 'many'), 'whole number, 4 to 5000'),
    (('night', '--polaris', '1'), 'whole number, 2 to 5000'),
    (('night', '--latitude', '95'), 'must be -90 to 90 degrees'),
    (('night', '--latitude', 'nan'), 'must be -90 to 90 degrees'),
    (('night', '--height', '1e9'), 'must be -500 to 9000 m'),
    (('night', '--seed', '-1'), 'whole number'),
    (('night', '--domain', '102'), 'whole number, 0 to 101'),
    (('night', '--time-scale', '-1'), 'must be 0 to 1000'),
    (('fit',), 'RUN'),
    (('fit', 'x.csv', '--encoder', 'both'), 'both'),
    (('fit', 'x.csv', '--azimuth-origin', 'E'), "'E'"),
    (('replay',), 'BAG'),
])
def test_bad_options_are_one_line(capsys, words, text):
    assert text in one_line(capsys, *words)


# --- night --------------------------------------------------------------------------------------


def test_an_output_that_is_in_use(capsys, tmp_path):
    (tmp_path / 'file').write_text('x')
    assert 'is not empty; choose another folder' in one_line(
        capsys, 'night', '--out', tmp_path)
    assert 'is a file' in one_line(capsys, 'night', '--out', tmp_path / 'file')
    assert 'file' in one_line(capsys, 'night', '--out', tmp_path / 'file' / 'under')
    assert sorted(p.name for p in tmp_path.iterdir()) == ['file']


def test_a_domain_in_use(capsys, tmp_path):
    lock = domain.claim()
    try:
        assert f'domain {lock.number} is in use on this machine' in one_line(
            capsys, 'night', '--out', tmp_path / 'n', '--domain', lock.number)
    finally:
        lock.release()


def test_files_that_are_not_there(capsys, tmp_path):
    assert 'is no file; give a ROS parameter file' in one_line(
        capsys, 'night', '--out', tmp_path / 'n', '--params', tmp_path / 'absent.yaml')
    assert 'absent.json' in one_line(
        capsys, 'night', '--out', tmp_path / 'n', '--reference', tmp_path / 'absent.json')
    (tmp_path / 'bad.json').write_text('{"format": "other"}')
    assert 'bad.json: not a pointing model' in one_line(
        capsys, 'night', '--out', tmp_path / 'n', '--reference', tmp_path / 'bad.json')


@pytest.mark.parametrize('words, text', [
    (('--scenario', 'no_such'), 'no_such'),
    (('--date', 'yesterday'), 'write 2026-01-15T13:00:00'),
    (('--latitude', '-40'), 'Polaris stands at'),
])
def test_what_the_nodes_refuse(refused, tmp_path, words, text):
    assert text in refused('night', '--out', tmp_path / 'n', '--stars', 4, '--polaris', 2, *words)


def params(tmp_path, **values):
    path = tmp_path / 'params.yaml'
    rows = ''.join(f'    {name}: {value}\n' for name, value in values.items())
    path.write_text(f'/mount/star_observer:\n  ros__parameters:\n{rows}')
    return path


@pytest.mark.parametrize('values, text', [
    ({'magnitude_limit': -1.9}, 'no star visible'),
    ({'min_elevation_dg': 30.0}, 'unknown parameter min_elevation_dg; did you mean min_elevation'),
])
def test_what_a_parameter_file_makes_impossible(refused, tmp_path, values, text):
    assert text in refused('night', '--out', tmp_path / 'n', '--stars', 4, '--polaris', 2,
                           '--params', params(tmp_path, **values))


# --- fit ----------------------------------------------------------------------------------------


def test_fit_prints_the_terms_and_saves_the_model(capsys, run_csv, tmp_path):
    saved = tmp_path / 'model.json'
    code, out, err = main(capsys, 'fit', run_csv, '--save', saved)
    assert (code, err) == (0, '')
    assert '60 rows' in out and str(saved) in out
    model = PointingModel.load(saved)
    for name in ('CA', 'NPAE', 'AN', 'AW', 'TF'):
        assert model.terms[name] / ARCSEC == pytest.approx(MOUNT.terms[name] / ARCSEC, abs=4.0)
        assert any(line.split()[:2] == [name, f'{model.terms[name] / ARCSEC:+.2f}']
                   for line in out.splitlines())


def test_fit_reads_the_log_of_a_night(night, cli):
    done = cli('fit', night / 'bag')
    assert done.returncode == 0, done.stderr
    assert '16 rows' in done.stdout
    assert '8 exposures of Polaris left out' in done.stdout
    assert 'fitted as one' not in done.stdout
    from_csv = cli('fit', night / 'observations.csv', '--encoder', 'abs')
    assert from_csv.returncode == 0, from_csv.stderr
    assert '2 runs (column run) fitted as one' in from_csv.stdout


def test_fit_takes_one_run_of_several(capsys, run_csv):
    from pointing_model.run_files import read_run, write_csv
    run = read_run(run_csv)
    run.columns['run'] = np.repeat([1, 2], 30)
    run.columns['el_enc'] = run['el_enc'] + 300.0 * ARCSEC * (run['run'] == 2)
    write_csv(run, run_csv)
    _, out, _ = main(capsys, 'fit', run_csv)
    assert '60 rows' in out and 'fitted as one' in out
    _, out, _ = main(capsys, 'fit', run_csv, '--run', 2)
    assert '30 rows' in out and 'fitted as one' not in out
    assert 'no run 7 (there: 1, 2)' in one_line(capsys, 'fit', run_csv, '--run', 7)


def test_fit_refuses_what_it_cannot_read(capsys, run_csv, tmp_path):
    text = run_csv.read_text()
    bad = tmp_path / 'bad.csv'
    bad.write_text(text.replace('el_enc_deg', 'el_enc'))
    assert 'el_enc' in one_line(capsys, 'fit', bad)
    lines = text.splitlines()
    number = next(i for i, line in enumerate(lines) if line[:1].isdigit()) + 3
    lines[number] = 'x' + lines[number]
    bad.write_text('\n'.join(lines))
    code, out, err = main(capsys, 'fit', bad)
    assert 'Traceback' not in err
    assert code == 2 and len(err.splitlines()) == 1 or 'left out' in out
    bad.write_text('')
    one_line(capsys, 'fit', bad)
    bad.write_bytes(bytes(range(256)) * 4)
    one_line(capsys, 'fit', bad)
    assert 'absent.csv' in one_line(capsys, 'fit', tmp_path / 'absent.csv')
    one_line(capsys, 'fit', tmp_path)


def test_fit_refuses_what_it_cannot_do(capsys, run_csv, tmp_path):
    assert 'XY' in one_line(capsys, 'fit', run_csv, '--terms', 'IA,XY')
    assert 'name at least one' in one_line(capsys, 'fit', run_csv, '--terms', ' , ')
    assert 'no second encoder; leave out --encoder abs' in one_line(
        capsys, 'fit', run_csv, '--encoder', 'abs')
    assert 'ends in .json' in one_line(capsys, 'fit', run_csv, '--save', tmp_path / 'model.txt')
    one_line(capsys, 'fit', run_csv, '--save', tmp_path / 'no' / 'model.json')
    lines = run_csv.read_text().splitlines()
    start = next(i for i, line in enumerate(lines) if line[:1].isdigit())
    (tmp_path / 'few.csv').write_text('\n'.join(lines[:start + 3]))
    assert 'observe' in one_line(capsys, 'fit', tmp_path / 'few.csv')


def test_fit_refuses_the_truth_and_a_log_cut_short(night, capsys, tmp_path):
    pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)
    assert 'holds the truth of the simulator; fit the log beside it' in one_line(
        capsys, 'fit', night / 'bag_truth')
    whole = next((night / 'bag').glob('*.mcap')).read_bytes()
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(whole[:200])
    assert 'observation' in one_line(capsys, 'fit', cut)
    cut.write_bytes(b'')
    assert 'is empty' in one_line(capsys, 'fit', cut)


# --- the end ------------------------------------------------------------------------------------


def test_ctrl_c_and_a_closed_pipe(capsys, monkeypatch, run_csv):
    def stop(error):
        def run(args):
            raise error
        return run
    monkeypatch.setattr(module, '_fit', stop(KeyboardInterrupt()))
    code, _, err = main(capsys, 'fit', run_csv)
    assert code == 130 and len(err.splitlines()) == 1
    monkeypatch.setattr(module, '_fit', stop(BrokenPipeError()))
    assert main(capsys, 'fit', run_csv)[::2] == (0, '')
    monkeypatch.setattr(module, '_fit', stop(OSError(28, 'No space left on device', 'model')))
    assert main(capsys, 'fit', run_csv) == (2, '', 'error: model: No space left on device\n')
    monkeypatch.setattr(module, '_fit', stop(ValueError('two\n  lines')))
    assert main(capsys, 'fit', run_csv) == (2, '', 'error: two lines\n')
    monkeypatch.setattr(module, '_fit', stop(TypeError('a bug')))
    with pytest.raises(TypeError):
        main(capsys, 'fit', run_csv)
