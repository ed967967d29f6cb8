"""What the commands print with: a console, a line of progress, tables and files."""

import sys
import time


def new_console():
    """A rich console, as wide as tables need on a pipe."""
    from rich.console import Console
    # a pipe has no width of its own; tables must not be cut there
    return Console(width=None if sys.stdout.isatty() else 120, highlight=False)


class Progress:
    """A line that tells how far the work is; on a pipe one line a step.

    Parameters
    ----------
    console : rich.console.Console
    unit : str
        What is counted.
    first : str
        What comes before the first count.
    after : float
        Seconds before which nothing is said on a pipe: what is fast needs no line.
    every : float
        Seconds after which a step has another line on a pipe.
    """

    def __init__(self, console, unit='exposures', first='starting the nodes', after=0.0,
                 every=float('inf')):
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
        self._bar = Progress(
            TextColumn('{task.description:<18}'), BarColumn(), MofNCompleteColumn(),
            TextColumn(unit), console=console, transient=True)
        self._console, self._unit, self._first = console, unit, first
        self._quiet_until, self._every = time.monotonic() + after, every
        self._task = None
        self._text, self._next = None, 0.0

    def __enter__(self):
        if self._console.is_terminal:
            self._bar.start()
            self._task = self._bar.add_task(self._first, total=None)
        return self

    def __exit__(self, *exc):
        if self._task is not None:
            self._bar.stop()

    def __call__(self, text, done, total):
        if self._task is not None:
            self._bar.update(self._task, description=text, completed=done, total=total)
            return
        now = time.monotonic()
        # before the first line of a step nothing is counted: that says nothing
        if total is not None and now >= self._quiet_until and (
                text != self._text or now >= self._next):
            self._console.print(f'{text}: {done} of {total} {self._unit} done')
            self._text, self._next = text, now + self._every


def print_lines(console, kind, lines):
    """Lines that begin with what they are: a note, an alarm, a loss."""
    for line in lines:
        console.print(f'{kind}: {line}', markup=False)


def print_files(console, files, width=13):
    """Name and path of what was written."""
    for name, path in files.items():
        console.print(f'{name:<{width}} {path}', markup=False)


def print_calibration(console, report):
    """A calibration report: its tables, notes and alarms."""
    from calibration.diagnosis.rows_told import expected_sentence
    from calibration.tables import night_tables
    if 'steps' in report:
        for table in night_tables(report):
            console.print(table)
        if report.get('expected'):
            console.print(expected_sentence(report))
        zeros = report['changes'] or report['zeros']
        witnesses = report['witnesses']
        print_lines(console, 'note', [*(zero['statement'] for zero in zeros[-1:]), *report['notes'],
                                      *witnesses['notes']])
        print_lines(console, 'alarm', witnesses['alarms'])
    else:
        print_lines(console, 'note', report['notes'])
    if 'tracking' in report:
        from calibration.tracking.told import tracking_lines
        print_lines(console, 'tracked', tracking_lines(report['tracking']))
    for check in report.get('checks', []):
        if check['stars']:
            console.print(f'{check["stars"]} fresh stars pointed at blind: '
                          f'{check["rms_arcsec"]:.2f} arcsec radial RMS, {check["lost"]} lost')
