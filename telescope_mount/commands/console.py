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

"""Output of the commands: a console, a progress line, tables and files."""

import math
import os
import select
import sys
import time
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from threading import RLock, Timer

from msg_tools.whole_files import tried, write_text

from ..processes import interrupt

#: s of work after which progress is shown
PATIENCE = 1.0
#: the same if there is no terminal: s until the first line, and between lines
FIRST_LINE, NEXT_LINE = 2.0, 10.0
#: number of counted parts of a step from which the remaining time is estimated
FEWEST_COUNTED = 2


def step_aside(for_good=False):
    """Remove the progress line for output that does not use `new_console`."""
    for shown in reversed(_SHOWN):
        shown.aside(for_good)


def new_console(stderr=False):
    """A rich console on a standard output, which removes the progress line for its output."""
    from rich.console import Console

    class StandardOutput(Console):

        def print(self, *objects, **options):
            step_aside()
            super().print(*objects, **options)

        def on_broken_pipe(self):
            from ..cli import silence_output
            silence_output()  # nobody reads on: the result still determines the exit code
    # a pipe has no width
    terminal = (sys.stderr if stderr else sys.stdout).isatty()
    wide = None if terminal or os.environ.get('COLUMNS', '').isdigit() else 120
    return StandardOutput(width=wide, stderr=stderr, highlight=False, markup=False, emoji=False)


#: active progress lines, the visible one last
_SHOWN = []


class ProgressLine:
    """A progress line on standard error: amount done, time left.

    It appears after `PATIENCE` seconds of work, is removed for other output, and leaves nothing
    behind. If standard error is no terminal, lines are printed there from time to time (`lines`);
    if neither output is one, a night prints one line per step.

    Parameters
    ----------
    console : rich.console.Console, optional
        Console of the results, for one line per step if there is no terminal; without it nothing
        is printed then.
    unit : str
        Name of what is counted.
    first : str
        Text before the first count.
    every : float
        Seconds after which a step prints another such line.
    lines : bool
        For work that a signal may interrupt anywhere: if standard error is no terminal, print a
        line after `FIRST_LINE` seconds of work and then every `NEXT_LINE`.
    """

    def __init__(self, console=None, unit='exposures', first='starting the nodes',
                 every=float('inf'), lines=False):
        self._lines = lines
        self._console, self._unit, self._every = console, unit, every
        self._lock, self._timer, self._bar = RLock(), None, None
        self._at = first, 0, None
        self._since = self._last = time.monotonic()
        self._last_text, self._next = None, 0.0
        self._began = first, self._since, 0

    def __enter__(self):
        for outer in _SHOWN:
            outer.aside(for_good=True)
        _SHOWN.append(self)
        self._wait()
        return self

    def __exit__(self, *exc):
        self.aside(for_good=True)
        _SHOWN.remove(self)
        for outer in _SHOWN[-1:]:
            outer._wait()

    def __call__(self, text, done=0, total=None):
        """Set the current step, and how much of it is done; `total` None: unknown."""
        if self._lines:  # this work may be interrupted here
            interrupt.check()
        with self._lock:
            self._at = text, done, total
            self._last = time.monotonic()
            if text != self._began[0]:
                self._began = text, self._last, done
            self._show()
        if self._console is not None and not (sys.stderr.isatty() or sys.stdout.isatty()):
            self._print_progress(text, done, total)

    def aside(self, for_good=False):
        """Remove the line; it returns after a while, unless `for_good`."""
        with self._lock:
            if self._timer is not None:
                self._timer.cancel()
                self._timer = None
            if self._bar is not None:
                self._bar.stop()
                self._bar = None
        if not for_good:
            self._wait()

    def _wait(self):
        if sys.stderr.isatty():
            self._after(PATIENCE, self._begin)
        elif self._lines:
            passed = time.monotonic() - self._since
            self._after(FIRST_LINE if passed < FIRST_LINE else NEXT_LINE, self._leave_line)

    def _after(self, seconds, what):
        self._timer = Timer(seconds, what)
        self._timer.daemon = True
        self._timer.start()

    def _leave_line(self):
        with self._lock:
            if self._timer is None:  # ended meanwhile
                return
            text, done, total = self._at
            count = f': {done} of {total} {self._unit}' if total is not None and done < total \
                else ''
            print(f'{text}{count}, {_clock(time.monotonic() - self._since)} so far'
                  f'{self._left() if count else ""}', file=sys.stderr, flush=True)
            self._wait()

    def _left(self):
        """Estimated time left of this step, in words; '' while too little is done."""
        (_, since, before), (_, done, total) = self._began, self._at
        if done - before < FEWEST_COUNTED:
            return ''
        each = (self._last - since) / (done - before)
        return f', about {_clock(each * (total - done))} left'

    def _begin(self):
        from rich.console import Console
        from rich.progress import BarColumn, Progress, ProgressColumn, SpinnerColumn, TextColumn
        from rich.text import Text

        class Left(ProgressColumn):
            """Time left if known, else time passed."""

            def render(self, task):
                left = None if task.total is None else task.time_remaining
                return Text(_clock(time.monotonic() - self.since) if left is None
                            else f'{_clock(left)} left')
        Left.since = self._since
        plain = not (sys.stderr.encoding or '').lower().startswith('utf')
        with self._lock:
            if self._timer is None:  # ended meanwhile
                return
            console = Console(stderr=True, highlight=False, markup=False, emoji=False)
            turning = SpinnerColumn('line' if plain else 'dots')
            # file names may contain something that looks like markup
            words, count = (TextColumn(field, markup=False) for field in (
                '{task.description}', '{task.fields[count]}'))
            # narrow terminals cut the end of the line, which should not be a number
            columns = ((turning, words, BarColumn(16), count, Left()) if console.width >= 75
                       else (turning, Left(), count, words))
            self._bar = Progress(
                *columns, console=console,
                transient=True, redirect_stdout=False, redirect_stderr=False)
            self._bar.add_task('', total=None, count='')
            self._show()
            self._bar.start()

    def _show(self):
        if self._bar is None:
            return
        text, done, total = self._at
        # show no count after the last one, since work may still follow
        known = total is not None and done < total
        self._bar.tasks[0].total = total if known else None  # `update` does not accept None
        self._bar.update(self._bar.task_ids[0], description=text, completed=done if known else 0,
                         count=f'{done} of {total} {self._unit}' if known else '')

    def _print_progress(self, text, done, total):
        now = time.monotonic()
        # a step without a count prints nothing
        if total is not None and (text != self._last_text or now >= self._next):
            self._console.print(f'{text}: {done} of {total} {self._unit} done')
            self._last_text, self._next = text, now + self._every


def _clock(seconds):
    """``0:07``, ``1:02:03``."""
    minutes, seconds = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f'{hours}:{minutes:02d}:{seconds:02d}' if hours else f'{minutes}:{seconds:02d}'


def check_reader():
    """End a command whose only output is a closed pipe (``| head -1``).

    Raises
    ------
    BrokenPipeError
    """
    if hasattr(select, 'poll'):
        poll = select.poll()
        poll.register(1, 0)  # errors are reported without being requested
        if any(event & select.POLLERR for _, event in poll.poll(0)):
            raise BrokenPipeError


def print_all(console, parts):
    """Print tables and lines."""
    for part in parts:
        console.print(part)


def print_finding(console, found):
    """Print the sentence of a Finding."""
    from calibration.report.wording import wording
    console.print(wording(found))


def print_lines(console, kind, lines):
    """Print lines with a prefix: a note, an alarm, a loss."""
    print_all(console, (f'{kind}: {line}' for line in lines))


def print_files(console, files, width=13):
    """Print names and paths of written files."""
    for name, path in files.items():
        console.print(f'{name:<{width}} {path}', soft_wrap=True)  # a path is for copying


def files_of(args):
    """Number of --json, --save and --report that name a file: lines of `write_outputs`."""
    return sum(isinstance(getattr(args, name, None), Path) for name in ('json', 'save', 'report'))


def print_calibration(console, report, verbose=False, files=0):
    """Print a calibration report: its results; with `verbose` all tables and notes.

    Parameters
    ----------
    console : rich.console.Console
    report : dict
    verbose : bool
    files : int
        Number of lines printed after it.
    """
    from calibration.report.night_tables import night_parts
    from calibration.report.terminal_layout import layered
    first, more, rest = night_parts(report) if 'steps' in report else (
        [], [f'note: {note}' for note in report['notes']], [])
    if 'tracking' in report:
        from calibration.report.track_page import tracking_lines
        more[:0] = [f'tracked: {line}' for line in tracking_lines(report['tracking'])]
    first += [f'{check["stars"]} fresh stars pointed at blind: {check["rms_arcsec"]:.2f} arcsec '
              f'radial RMS, {check["lost"]} lost'
              for check in report.get('checks', []) if check['stars']]
    print_all(console, layered(first, more, verbose, files, rest))


def write_json(path, document):
    """Write a result as --json of all commands does; non-finite numbers become null.

    Parameters
    ----------
    path : Path
        As parsed.
    document : dict or list
    """
    import json
    text = json.dumps(_plain(document), indent=1, allow_nan=False) + '\n'
    if isinstance(path, Path):
        write_text(path, text)
    else:
        path.write_text(text)


@contextmanager
def refusal_as_json(path, document):
    """Within, what refuses the columns of a run goes to --json, too: a function of `documents`."""
    from calibration.analysis.diagnosis.mistaken_columns import MistakenColumns
    try:
        yield
    except MistakenColumns as error:
        if path:
            from calibration.report import documents
            write_json(path, getattr(documents, document)(error))
        raise


def _plain(value):
    """Convert a value to what JSON can hold."""
    if isinstance(value, dict):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, bool | int | str):
        return value
    if hasattr(value, 'tolist'):
        return _plain(value.tolist())
    return str(value)


def hold_up_lines(console):
    """For a night: prints why it is held up, and that it goes on ('')."""
    return lambda text: console.print(f'held up: {text}' if text else 'goes on')


def end_of_night(console, json, report, width=13):
    """Write --json, list the existing files, and report incomplete outputs.

    Parameters
    ----------
    console : rich.console.Console
    json : Path or None
        As parsed.
    report : dict
        With ``files``, names and paths, and ``incomplete``, a line for each incomplete
        output.
    width : int
        Width of the names.

    Returns
    -------
    int
        The exit code.
    """
    incomplete = list(report['incomplete'])
    files = dict(report['files'])
    if json is not None:
        tried(incomplete, json, partial(write_json, document=report))
        files['report'] = json
    print_files(console, {name: path for name, path in files.items()
                          if not any(line.startswith(f'{path}: ') for line in incomplete)}, width)
    if incomplete:
        step_aside()
        print(f'error: incomplete: {"; ".join(incomplete)}', file=sys.stderr)
    return int(bool(incomplete))


def write_outputs(console, args, document, what='result', model=None, page=None):
    """Write the files of --json, --save and --report, and print their paths.

    Parameters
    ----------
    console : rich.console.Console
    args : argparse.Namespace
    document : dict or list
    what : str
        Name of `document`.
    model : callable, optional
        Writes the model to a path.
    page : str, optional
        HTML.
    """
    for name, write, called in (('json', partial(write_json, document=document), what),
                                ('save', model, 'model'),
                                ('report', page and partial(write_text, text=page), 'page')):
        path = getattr(args, name, None)
        if not path or write is None:
            continue
        try:
            write(path)
        except OSError as error:
            if error.filename is None:  # a full disk gives no name
                error.filename = str(path)
            raise
        print_files(console, {called: path})
