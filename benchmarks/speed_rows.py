"""Rows of the speed benchmarks: what, size, seconds of ours and of a peer."""

import importlib
import time
from typing import NamedTuple


class Row(NamedTuple):
    """What was timed, in one run with the peer; `ratio` is peer / ours: above 1 ours is faster."""

    what: str
    size: int
    ours: float
    peer: float
    peer_name: str
    ratio: float


def best_of(candidates, rounds, calls=1):
    """Seconds a call of each of some callables, the best of interleaved rounds.

    Parameters
    ----------
    candidates : dict of str to callable
    rounds : int
        After one that warms up.
    calls : int
        In a row, in each round.

    Returns
    -------
    dict of str to float
    """
    best = dict.fromkeys(candidates, float('inf'))
    for lap in range(rounds + 1):
        for name, call in candidates.items():
            begin = time.perf_counter()
            for _ in range(calls):
                call()
            if lap:
                best[name] = min(best[name], (time.perf_counter() - begin) / calls)
    return best


def peer(name):
    """A peer's module, or None with a line that says how to install it."""
    try:
        return importlib.import_module(name)
    except ImportError:
        print(f'{name} is absent: .venv/bin/pip install {name}')
        return None


def show(rows):
    """Print rows as a table."""
    print(f'{"":58} {"size":>8} {"ours, us":>12} {"peer, us":>12} {"peer / ours":>12}  peer')
    for row in rows:
        print(f'{row.what:58} {row.size:8} {row.ours * 1e6:12.2f} {row.peer * 1e6:12.2f} '
              f'{row.ratio:12.2f}  {row.peer_name}')


def row(what, size, times, ours, theirs):
    """A `Row` of two of the times of `best_of`."""
    return Row(what, size, times[ours], times[theirs], theirs, times[theirs] / times[ours])
