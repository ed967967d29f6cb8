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

"""Fair timing of our code against what a user would run instead, and scaling of cost with size.

Candidates take turns, so that a temporarily slow machine affects all of them. The best round
counts, since disturbances only add time. Used by `all.py` and by other benchmarks.
"""

import argparse
import gc
import importlib
import math
import sys
import time
import tracemalloc
from dataclasses import asdict, dataclass

#: s of one measurement at least: shorter calls are repeated
SHORTEST = 0.02


@dataclass(frozen=True)
class Row:
    """A line of the table.

    Parameters
    ----------
    part, what, size : str
        Of the table; together they name the line in the history.
    ours : float
        Seconds, or in `unit`.
    peer : str
        What is beside it: a program, or a limit.
    theirs : float or None
        As `ours`, of the peer; None where it is not installed.
    least : float or None
        What the ratio must be at least.
    note : str
    unit : str
        '' for seconds.
    """

    part: str
    what: str
    size: str
    ours: float
    peer: str
    theirs: float | None
    least: float | None = None
    note: str = ''
    unit: str = ''

    @property
    def key(self):
        """Its name in the history."""
        return ' | '.join((self.part, self.what, self.size, self.peer))

    @property
    def ratio(self):
        """Speed relative to the peer; None without one."""
        return None if self.theirs is None or not self.ours else self.theirs / self.ours

    @property
    def met(self):
        """Whether it meets its target; None without a target."""
        return None if self.least is None or self.ratio is None else self.ratio >= self.least

    def document(self):
        """As JSON has it."""
        return {**asdict(self), 'ratio': self.ratio, 'met': self.met}


def seconds(value):
    """A time as people read it."""
    if value is None:
        return '-'
    unit, factor = next(pair for pair in (('s', 1.0), ('ms', 1e3), ('us', 1e6), ('ns', 1e9))
                        if value * pair[1] >= 1.0 or pair[0] == 'ns')
    return f'{value * factor:.3g} {unit}'


def show(rows):
    """Print rows as a table."""
    from rich.console import Console
    from rich.table import Table
    out = Table(title='Ratio: times as fast as the peer or the limit')
    for name in ('part', 'what', 'size', 'ours', 'peer', 'theirs', 'ratio', 'at least', 'note'):
        out.add_column(name, justify='right' if name in ('ours', 'theirs', 'ratio', 'at least')
                       else 'left')
    for row in rows:
        ours, theirs = (f'{value:.3g} {row.unit}' if row.unit and value is not None
                        else seconds(value) for value in (row.ours, row.theirs))
        out.add_row(row.part, row.what, row.size, ours, row.peer, theirs,
                    '-' if row.ratio is None else f'{row.ratio:.2f}',
                    '' if row.least is None else
                    f'{row.least:.2f}' + (' MISSED' if row.met is False else ''), row.note)
    Console(width=None if sys.stdout.isatty() else 160).print(out)


def show_rows(doc, rows):
    """The `main` of a benchmark that only has ``rows(rounds)``; the only option is `--rounds`."""
    parser = argparse.ArgumentParser(description=doc.splitlines()[0])
    parser.add_argument('--rounds', type=int, default=5)
    show(rows(parser.parse_args().rounds))


def peer(name):
    """A peer's module, or None with a line that says how to install it."""
    try:
        return importlib.import_module(name)
    except ImportError:
        print(f'{name} is absent: .venv/bin/pip install {name}')
        return None


def _calls(call):
    """How often `call` is made in a row to take `SHORTEST` seconds; it is made at least twice."""
    call()
    begin = time.perf_counter()
    call()
    return max(1, math.ceil(SHORTEST / max(time.perf_counter() - begin, 1e-7)))


def race(calls, rounds=5, clock=time.perf_counter):
    """Best time of each candidate, seconds per call.

    Parameters
    ----------
    calls : dict of str to callable
        Without arguments.
    rounds : int
        In each, every candidate has a turn.
    clock : callable

    Returns
    -------
    dict of str to float
    """
    times, best = {name: _calls(call) for name, call in calls.items()}, {}
    gc.collect()
    gc.disable()
    try:
        for _ in range(rounds):
            for name, call in calls.items():
                begin = clock()
                for _ in range(times[name]):
                    call()
                took = (clock() - begin) / times[name]
                best[name] = min(best.get(name, math.inf), took)
    finally:
        gc.enable()
    return best


def exponent(sizes, costs):
    """Exponent of the growth of cost between the two largest sizes, without the fixed cost.

    Parameters
    ----------
    sizes, costs : sequence of float
        Ascending sizes, three at least; the cost of the smallest is taken as the fixed one.

    Returns
    -------
    float
        0.0 where no growth is seen.
    """
    first, *_, before, last = map(float, costs)
    if last <= 1.2 * first:
        return 0.0
    before = max(before - first, 0.01 * (last - first))  # of noise no power of more than two
    return math.log((last - first) / before) / math.log(sizes[-1] / sizes[-2])


def peak_memory(call):
    """Peak memory that `call` allocates, bytes, including numpy arrays."""
    gc.collect()
    tracemalloc.start()
    try:
        call()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@dataclass(frozen=True)
class Curve:
    """Cost of an operation at several sizes."""

    what: str
    unit: str
    sizes: tuple
    seconds: tuple
    bytes: tuple

    @property
    def power(self):
        """Exponent of time."""
        return exponent(self.sizes, self.seconds)

    @property
    def power_of_memory(self):
        """Exponent of memory; 0.0 below 4 MB, where it is meaningless."""
        return exponent(self.sizes, self.bytes) if max(self.bytes) > 4e6 else 0.0

    @property
    def met(self):
        """No worse than n log n, which between two sizes is a power somewhat above 1."""
        n, m = self.sizes[-1], self.sizes[-2]
        limit = 1.0 + math.log(math.log(n) / math.log(m)) / math.log(n / m) + 0.08  # and noise
        return self.power <= limit and self.power_of_memory <= limit

    def document(self):
        """As JSON has it."""
        return {**asdict(self), 'power': self.power, 'power_of_memory': self.power_of_memory,
                'met': self.met}


def curve(what, unit, sizes, prepare, rounds=3):
    """Measure a curve.

    Parameters
    ----------
    what, unit : str
        Of the table.
    sizes : sequence of int
    prepare : callable
        ``prepare(size)`` returns what is timed, a callable without arguments.
    rounds : int

    Returns
    -------
    Curve
    """
    seconds, memory = [], []
    for size in sizes:
        call = prepare(size)
        seconds.append(race({'': call}, rounds)[''])
        memory.append(peak_memory(call))
    return Curve(what, unit, tuple(sizes), tuple(seconds), tuple(memory))
