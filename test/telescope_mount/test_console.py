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

"""What the commands print with."""

import os
import threading

import pytest

from telescope_mount.commands import console


def test_a_name_with_brackets_is_no_markup_in_the_line_of_progress(monkeypatch, capsys):
    monkeypatch.setattr('sys.stderr.isatty', lambda: True)
    monkeypatch.setattr(console, 'PATIENCE', 3600.0)
    with console.ProgressLine() as progress:
        progress('a[/]b.csv', 1, 3)
        progress._begin()
    assert 'a[/]b' in capsys.readouterr().err


def test_without_a_terminal_long_work_leaves_a_line_now_and_then(monkeypatch, capsys):
    monkeypatch.setattr(console, 'FIRST_LINE', 0.0)
    monkeypatch.setattr(console, 'NEXT_LINE', 0.01)
    left = threading.Event()
    with console.ProgressLine(unit='folds', first='looking', lines=True) as progress:
        leave, lines = progress._leave_line, []

        def counted():
            leave()
            lines.append(1)
            if len(lines) > 2:
                left.set()
        progress._leave_line = counted
        progress('cross-validation', 3, 8)
        assert left.wait(30.0)
    out, err = capsys.readouterr()
    assert out == '' and 'cross-validation: 3 of 8 folds, 0:0' in err


def test_short_work_says_nothing_where_no_terminal_is(capsys):
    with console.ProgressLine(lines=True) as progress:
        progress('cross-validation', 3, 8)
    assert capsys.readouterr() == ('', '')


def test_how_long_a_step_will_take_is_told_by_its_own_counts(monkeypatch, capsys):
    clock = iter([0.0, 100.0])  # what came before took long
    monkeypatch.setattr(console.time, 'monotonic', lambda: next(clock, 130.0))
    progress = console.ProgressLine(unit='folds', first='looking')
    progress._wait, progress._timer = lambda: None, True
    progress('cross-validation', 1, 9)
    progress._leave_line()
    progress('cross-validation', 4, 9)
    progress._leave_line()
    first, second = capsys.readouterr().err.splitlines()
    assert first.endswith('so far') and second.endswith('2:10 so far, about 0:50 left')


def test_work_ends_when_nobody_reads_its_output_on():
    reader, writer = os.pipe()
    kept = os.dup(1)
    try:
        os.dup2(writer, 1)
        os.close(writer)
        console.check_reader()
        os.close(reader)
        with pytest.raises(BrokenPipeError):
            console.check_reader()
    finally:
        os.dup2(kept, 1)
        os.close(kept)
