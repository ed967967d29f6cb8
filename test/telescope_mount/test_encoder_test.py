import json

import numpy as np
import pytest

from msg_tools.units import ARCSEC
from telescope_mount import encoder_test
from telescope_mount.encoder_test import (
    TABLE_2_MEASURED,
    TABLE_2_STANDARD,
    evaluate,
    harmonic_verdict,
    needed,
    sigma_interval,
)

PRINTED_ERRORS = [
    0.64, -7.27, -7.59, 6.28, 3.88, 0.67, -0.27, -6.41, 6.31, 7.71, 1.76, 3.92, 6.8, 3.75, 0.23,
    2.71, -0.34, -4.89, -1.78, 7.39, -0.43, -1.56, 2.99]


def test_table_2():
    found = evaluate(TABLE_2_MEASURED, TABLE_2_STANDARD)
    assert found.graduation_errors / ARCSEC == pytest.approx(PRINTED_ERRORS, abs=1e-6)
    assert found.mean / ARCSEC == pytest.approx(1.065, abs=5e-4)
    assert found.std / ARCSEC == pytest.approx(4.571, abs=5e-4)
    assert found.largest / ARCSEC == pytest.approx(7.71, abs=1e-6)
    assert found.smallest / ARCSEC == pytest.approx(0.23, abs=1e-6)
    # the printed standard angles are 23 equal parts, cut off at 0.1"
    exact = 2 * np.pi * np.arange(23) / 23
    assert np.abs(TABLE_2_STANDARD - exact).max() < 0.1 * ARCSEC


def test_nothing_found_in_table_2():
    verdict = harmonic_verdict(np.array(PRINTED_ERRORS) * ARCSEC)
    assert not verdict.found and verdict.holm.min() > 0.9
    assert verdict.std_without / ARCSEC == pytest.approx(2.43, abs=0.005)
    assert verdict.left_out / ARCSEC == pytest.approx(4.67, abs=0.005)
    assert verdict.left_out_without / ARCSEC == pytest.approx(5.47, abs=0.005)


def test_harmonics_against_a_plain_fit():
    n, rng = 23, np.random.default_rng(1)
    angle = 2 * np.pi * np.arange(n) / n
    errors = rng.normal(size=n) + 1.5 * np.cos(2 * angle - 0.4)
    verdict = harmonic_verdict(errors)
    assert verdict.found and np.argmin(verdict.holm) == 1
    for k in range(1, 7):
        columns = np.stack([np.ones(n), np.cos(k * angle), np.sin(k * angle)], axis=1)
        rest = errors - columns @ np.linalg.lstsq(columns, errors, rcond=None)[0]
        centred = errors - errors.mean()
        f = (centred @ centred - rest @ rest) / 2 / (rest @ rest / (n - 3))
        from scipy.stats import f as f_distribution
        assert verdict.p_values[k - 1] == pytest.approx(f_distribution.sf(f, 2, n - 3), rel=1e-9)
    # leave one out in earnest
    columns = np.stack([np.ones(n), *(g(k * angle) for k in range(1, 7) for g in (np.cos, np.sin))],
                       axis=1)
    misses = []
    for i in range(n):
        keep = np.arange(n) != i
        fit = np.linalg.lstsq(columns[keep], errors[keep], rcond=None)[0]
        misses.append(errors[i] - columns[i] @ fit)
    assert verdict.left_out_without == pytest.approx(np.sqrt(np.mean(np.square(misses))), rel=1e-9)
    with pytest.raises(ValueError, match='more than 13'):
        harmonic_verdict(np.ones(13))


def test_evaluation_takes_differences_around_the_turn():
    found = evaluate([2 * np.pi - 1e-6, 1.0], [1e-6, 1.0 + 2e-6])
    assert found.graduation_errors == pytest.approx([-2e-6, -2e-6], abs=1e-12)
    assert found.std == pytest.approx(0.0, abs=1e-12)
    assert evaluate([1e-6, 3e-6], [0.0, 0.0]).std == pytest.approx(np.sqrt(2.0) * 1e-6)


@pytest.mark.parametrize('measured, standard, text', [
    ([1.0], [1.0], 'at least two'),
    ([1.0, 2.0], [1.0, 2.0, 3.0], 'as many'),
    ([1.0, np.nan], [1.0, 2.0], 'angle 2 is not a finite number'),
])
def test_bad_angles(measured, standard, text):
    with pytest.raises(ValueError, match=text):
        evaluate(measured, standard)


def test_interval_of_sigma():
    # 22 degrees of freedom: chi square 10.982 and 36.781
    assert sigma_interval(4.57, 23) == pytest.approx((3.534, 6.468), abs=0.002)


def test_level_that_makes_a_rival_as_bad_as_printed():
    rows = [{'disturbance': 'noise', 'unit': 'grey levels', 'level': level, 'paper': 4.0 + level,
             'centroid': 10.0 * level, 'parabola': level, 'r_square': 0.8 - 0.1 * level}
            for level in (1.0, 2.0, 3.0)]
    centroid, parabola = needed(rows)
    assert centroid['level'] == pytest.approx(2.677)
    assert centroid['paper_arcsec'] == pytest.approx(6.677)
    assert centroid['r_square'] == pytest.approx(0.5323)
    assert parabola['level'] is None


@pytest.fixture(scope='module')
def report():
    return encoder_test.run(seed=2, turns=2)


def test_report(report):
    methods = report['methods']
    assert {'paper', 'centroid', 'parabola', 'template'} <= set(methods)
    for row in methods.values():
        assert {'std_arcsec', 'max_arcsec', 'rejected', 'gross'} <= set(row)
    assert methods['template']['std_arcsec'] < 0.6
    assert methods['template']['rejected'] == methods['template']['gross'] == 0
    assert 2.5 < methods['paper']['std_arcsec'] < 6.0
    assert methods['paper_by_centres']['gross'] == 0
    hurt = report['damaged']['methods']
    assert hurt['template']['max_arcsec'] < 3.0 < 10.0 < hurt['paper_by_centres']['rms_arcsec']
    # what made the printed comparison: the order of the methods turns round with the noise
    loud = report['noise_of_the_paper']['methods']
    assert methods['parabola']['std_arcsec'] < methods['paper_by_centres']['std_arcsec']
    assert loud['paper_by_centres']['std_arcsec'] < loud['parabola']['std_arcsec']
    assert json.loads(json.dumps(report, allow_nan=False)) == report


def test_tables_and_picture(report, tmp_path):
    from io import StringIO

    from rich.console import Console
    console = Console(width=140, record=True, file=StringIO())
    for table in encoder_test.tables(report):
        console.print(table)
    text = console.export_text()
    assert '1.065   4.571   7.710   0.230' in text
    assert 'bar position error, um' in text
    assert any('nothing found' in note for note in encoder_test.notes(report))
    path = tmp_path / 'test.png'
    encoder_test.plot(report, path)
    assert path.read_bytes().startswith(b'\x89PNG')


def test_command(monkeypatch, tmp_path, capsys, report):
    from telescope_mount.cli import main
    seen = []
    monkeypatch.setattr(encoder_test, 'run', lambda *args: seen.append(args[:3]) or report)
    out, figures = tmp_path / 'new' / 'out', tmp_path / 'figures.json'
    assert main(['encoder-test', '--out', str(out), '--json', str(figures), '--pitch', '60']) == 0
    assert seen == [(1, 20, 60)]
    assert (out / 'encoder_test.png').stat().st_size > 10_000
    assert json.loads(figures.read_text())['methods'] == report['methods']
    assert 'template' in capsys.readouterr().out
    assert main(['encoder-test', '--out', str(tmp_path), '--json', str(tmp_path)]) == 2
    assert capsys.readouterr().err.startswith('error: ')
