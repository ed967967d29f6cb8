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

"""What each command prints first fits into a terminal; the rest comes with --verbose."""

import json
import shutil

import pytest
from kepler_orbit import sp3
from places import ROOT

from calibration.report.terminal_layout import COLUMNS, LINES
from telescope_mount.commands.console import new_console, print_calibration

TUTORIAL = ROOT / 'examples' / 'tutorial'
NIGHT = ROOT / 'examples' / 'night'
MMT = ROOT / 'calibration' / 'data' / 'mmt_2021-08-21.csv'
#: terms of which two columns have no room for notes
MANY = ('IA,IE,CA,NPAE,AN,AW,TF,TX,TX3,ECES,HECE2,HESE2,ACEC,ACES,HACA2,HASA2,HECA,HESA,HECA2,'
        'HESA2,HVCA2,HVSA2')


@pytest.fixture(autouse=True)
def narrow(monkeypatch):
    monkeypatch.setenv('COLUMNS', str(COLUMNS))


def fits(text):
    lines = text.splitlines()
    # a path is one line, however long
    assert 0 < len(lines) <= LINES, text
    assert all(len(line) <= COLUMNS or '/' in line for line in lines), text


@pytest.mark.parametrize('words', [
    ('fit', MMT), ('fit', MMT, '--terms', MANY), ('fit', MMT, '--harmonics', 'zenith'),
    ('fit', TUTORIAL / 'german_solved.csv'), ('fit', NIGHT),
    ('diagnose', TUTORIAL / 'altaz_night1.csv'), ('track', MMT),
    ('bolts', TUTORIAL / 'german_solved.csv'), ('info', NIGHT), ('info', NIGHT / 'bag', '--quick'),
    ('watch', NIGHT)], ids=lambda words: words[0])
def test_a_command_on_sample_data(ended, words):
    code, out, _ = ended(*words)
    assert code == 0
    fits(out)


def test_what_is_left_out_comes_with_verbose(ended):
    short, long = (ended('fit', MMT, *more)[1] for more in ((), ('--verbose',)))
    assert 'more: --verbose' in short and 'more: --verbose' not in long
    assert len(long.splitlines()) > len(short.splitlines())


def test_the_encoder_test(ended, tmp_path):
    code, out, _ = ended('encoder-test', '--turns', 2, '--out', tmp_path / 'out')
    assert code == 0
    fits(out)


def test_many_passes(ended, tmp_path):
    for i in range(6):
        (tmp_path / f'{i}.sp3').write_text(sp3(
            [120.0 * k for k in range(720)], name=f'L{50 + i}', velocities=False))
    files = [word for i in range(6) for word in ('--orbit', tmp_path / f'{i}.sp3')]
    code, out, _ = ended('passes', *files, '--latitude', 34.3, '--longitude', 109, '--day-too')
    assert code == 0
    fits(out)


def test_a_night(capsys):
    report = json.loads((NIGHT / 'report.json').read_text())
    print_calibration(new_console(), report, files=5)
    out = capsys.readouterr().out
    fits(out + 5 * 'file\n')
    assert 'RMS on the sky' in out and 'more: --verbose' in out


def test_a_log_that_is_read_anew(ended, tmp_path):
    shutil.copytree(NIGHT / 'bag', tmp_path / 'bag')
    for command in ('verify', 'recover'):
        out = ended(command, tmp_path / 'bag', *['--out', tmp_path / 'new'] * (
            command == 'recover'))[1]
        fits(out)
