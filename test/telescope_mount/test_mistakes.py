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

"""What a newcomer does wrong: one line that says what, where, and what to do next; code 2 (130).

`mistakes.MISTAKES` is the list; here are those that need a process, a terminal or rights of their
own.
"""

import contextlib
import json
import math
import os
import random
import select
import signal
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path

import mistakes
import pytest
from places import ROOT

NEED_ROS = ('night', 'observe', 'guard', 'lifecycle')


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp('newcomer')
    mistakes.make(folder)
    return folder


@pytest.mark.parametrize('words, parts', [
    pytest.param(words.split(), parts, id=name) for name, words, *parts in mistakes.MISTAKES])
def test_a_mistake_is_one_line(refused, folder, monkeypatch, words, parts):
    if words and words[0] in NEED_ROS and find_spec('rclpy') is None:
        pytest.skip('rclpy is not installed (./install.sh ros)')
    monkeypatch.chdir(folder)
    line = refused(*words)
    assert all(part in line for part in parts), line
    assert 'Traceback' not in line and '  ' not in line


@pytest.mark.parametrize('file, line, said', mistakes.FAULTS_OF_A_ROW)
def test_a_fault_of_a_row_costs_the_row(ended, folder, monkeypatch, file, line, said):
    monkeypatch.chdir(folder)
    code, out, err = ended('fit', file)
    assert (code, err) == (0, '') and f'line {line} left out: {said}' in ' '.join(out.split())


def test_what_is_no_mistake_works(ended, folder, monkeypatch):
    """Files as spreadsheets of any country save them."""
    monkeypatch.chdir(folder)
    text = Path('run.csv').read_text()
    wanted = [line for line in ended('fit', 'run.csv')[1].splitlines() if line[:4] == ' IA ']
    for content in ('\ufeff' + text, text.replace(',', ';'),
                    text.replace(',', ';').replace('.', ','), text.replace('\n', '\r\n'),
                    text.replace(',', '\t').replace('.', ',')):
        for encoding in ('utf-8', 'utf-16'):
            Path('saved.csv').write_text(content.removeprefix('\ufeff') if encoding == 'utf-16'
                                         else content, encoding=encoding, newline='')
            code, out, err = ended('fit', 'saved.csv')
            assert (code, err) == (0, '') and wanted[0] in out


def test_json_is_all_there_is(ended, folder, monkeypatch):
    monkeypatch.chdir(folder)
    for words in (('fit', 'run.csv', '--json'), ('fit', '--json', 'run.csv'),
                  ('info', '--json', 'bag'), ('night', '--scenario', 'list', '--json')):
        if words[0] in NEED_ROS and find_spec('rclpy') is None:
            continue
        code, out, err = ended(*words)
        assert (code, err) == (0, '') and json.loads(out)
    code, out, err = ended('fit', 'e.csv', '--json')  # what is refused is told there, too
    assert code == 2 and err.count('\n') == 1 and json.loads(out)['readings']


# --- as a process --------------------------------------------------------------------------------


def run(*words, cwd, env=None, **options):
    return subprocess.Popen(
        [sys.executable, '-m', 'telescope_mount', *words], cwd=cwd, text=True,
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        env={**os.environ, 'PYTHONPATH': str(ROOT), **(env or {})}, **options)


def test_what_may_only_be_read(refused, folder, tmp_path, monkeypatch):
    if os.getuid() == 0:  # who may write everywhere
        monkeypatch.setattr(os, 'access', lambda *_: False)
    else:
        tmp_path.chmod(0o555)
    line = refused('fit', folder / 'run.csv', '--save', tmp_path / 'model.json')
    assert 'model.json cannot be written: the folder may only be read; name another' in line


def test_ctrl_c_is_one_line_and_130(folder, tmp_path):
    """While it imports, and while it works."""
    log = tmp_path / 'run.csv'
    log.write_text((folder / 'run.csv').read_text())
    for delay in (0.3, 1.2):
        process = run('diagnose', ROOT / 'calibration/data/mmt_2021-08-21.csv', cwd=tmp_path,
                      preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler))
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(delay)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
        # where it has interrupted some imports, Python ends itself by the signal: 130 in a shell
        assert process.returncode in (130, -signal.SIGINT), (delay, err)
        assert err == 'ended by Ctrl-C\n', (delay, err)


def test_a_terminal_that_knows_no_greek(folder):
    env = {'PYTHONIOENCODING': 'ascii', 'LC_ALL': 'C'}
    process = run('fit', 'run.csv', cwd=folder, env=env)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (0, '') and out.isascii()
    assert 'term, encoder - catalogue' in out
    process = run('fit', 'Ωmega.csv', cwd=folder, env=env)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out) == (2, '') and err.isascii() and err.count('\n') == 1


def test_who_reads_no_further_is_no_error(folder):
    process = run('export', 'run.csv', '/dev/stdout', '--overwrite', cwd=folder)
    process.stdout.read(10)
    process.stdout.close()
    assert (process.wait(60), process.stderr.read()) == (0, '')


def test_progress_is_on_a_terminal_only(folder, tmp_path):
    import pty
    # effects enough that no machine is done before the time left is told
    rng, rows = random.Random(5), ['az_deg,el_deg,az_enc_deg,el_enc_deg']
    for _ in range(200):
        az, el = rng.uniform(0.0, 360.0), rng.uniform(15.0, 80.0)
        x, y, z = (2e-3 * math.sin(math.radians(k * az)) for k in (2.0, 3.0, 7.3))
        rows.append(f'{az},{el},{az + rng.gauss(x, 3e-4)},'
                    f'{el + rng.gauss(y + z + 1e-5 * (el - 50.0)**2, 3e-4)}')
    (tmp_path / 'run.csv').write_text('\n'.join(rows))
    master, slave = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, '-m', 'telescope_mount', 'diagnose', 'run.csv'], cwd=tmp_path,
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=slave,
        env={**os.environ, 'PYTHONPATH': str(ROOT), 'TERM': 'xterm', 'COLUMNS': '80'},
        # a suite in the background of a script ignores Ctrl-C, and its children would too
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler))
    os.close(slave)
    seen, deadline = b'', time.monotonic() + 60
    while b' left' not in seen and time.monotonic() < deadline:
        seen += os.read(master, 4096)
    process.send_signal(signal.SIGINT)
    # a terminal takes few lines that nobody reads: who writes more than that would never end
    with contextlib.suppress(OSError):  # EIO: the last that had it open has ended
        while select.select([master], [], [], 60.0)[0] and os.read(master, 4096):
            pass
    out, _ = process.communicate(timeout=60)
    os.close(master)
    assert b'folds' in seen and b' left' in seen
    # of the diagnosis itself there is what its search found
    assert out.startswith(b'first answer, not yet validated: ')
    assert b'folds' not in out and b'rows used' not in out


def test_a_damaged_log_is_one_though_nobody_reads_on(tmp_path):
    data = next((ROOT / 'examples' / 'night' / 'bag').glob('*.mcap')).read_bytes()
    (tmp_path / 'cut.mcap').write_bytes(data[:len(data) // 2])
    process = run('info', 'cut.mcap', cwd=tmp_path)
    process.stdout.close()
    assert (process.wait(60), process.stderr.read()) == (1, '')
