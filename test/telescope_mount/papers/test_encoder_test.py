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

import json

import pytest

from telescope_mount.papers import encoder_test
from telescope_mount.papers.encoder_test import needed


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
    return encoder_test.run(seed=2, turns=1)


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


def test_tables(report):
    from io import StringIO

    from rich.console import Console
    console = Console(width=140, record=True, file=StringIO())
    for table in encoder_test.tables(report):
        console.print(table)
    text = console.export_text()
    assert '1.065   4.571   7.710   0.230' in text
    assert 'bar position error, um' in text
    assert any('nothing found' in note for note in encoder_test.notes(report))


def test_command(monkeypatch, tmp_path, capsys, report):
    from telescope_mount.cli import main
    seen = []
    monkeypatch.setattr(encoder_test, 'run', lambda *args: seen.append(args[:3]) or report)
    out, figures = tmp_path / 'new' / 'out', tmp_path / 'figures.json'
    assert main(['encoder-test', '--out', str(out), '--json', str(figures), '--pitch', '60']) == 0
    assert seen == [(1, 20, 60)]
    assert json.loads(figures.read_text())['methods'] == report['methods']
    page = (out / 'page.html').read_text(encoding='utf-8')
    assert f'{report["methods"]["template"]["std_arcsec"]:.2f}″ by the template' in page
    assert len(page) < 400_000 and '>nan' not in page
    assert str(out / 'page.html') in (said := capsys.readouterr().out) and 'template' in said
    nowhere = str(tmp_path / 'no' / 'out.json')
    assert main(['encoder-test', '--out', str(tmp_path), '--json', nowhere]) == 2
    assert capsys.readouterr().err.startswith('error: ')
