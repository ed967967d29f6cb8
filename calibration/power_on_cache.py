"""What was computed of a power-on alone, kept for as long as nothing of it changes.

A power-on that is over gives the same rows, and the same numbers of them, at each later fit.
"""

import hashlib
import json
import zlib

import numpy as np

from pointing_model.runs.run import PointingRun


class Finished:
    """Results by what they are and of which power-on, each with a digest of what went in."""

    def __init__(self):
        self._kept = {}

    def __len__(self):
        return len(self._kept)

    def once(self, name, inputs, make):
        """What ``make()`` gave last, if it was of the same inputs; else what it gives now.

        Parameters
        ----------
        name : tuple
            Which result, and the number of its power-on: the last one of each name is kept.
        inputs : iterable of (PointingRun, ndarray, str, float or None)
            All that `make` depends on.
        make : callable
            Its result is not changed by anyone. What it raises is not kept.
        """
        own = _digest(inputs)
        known = self._kept.get(name)
        if known is None or known[0] != own:
            self._kept[name] = known = own, make()
        return known[1]

    def forget(self, power_ons):
        """Results of all power-ons but these, a set of their numbers."""
        self._kept = {name: kept for name, kept in self._kept.items() if name[1] in power_ons}


def _digest(inputs):
    out = hashlib.blake2b(digest_size=16)
    for one in inputs:
        if isinstance(one, PointingRun):
            out.update(repr((*one.columns, one.mount)).encode())
            for column in one.columns.values():
                _add(out, column)
        elif isinstance(one, np.ndarray):
            _add(out, one)
        else:
            out.update(repr(one).encode())
        out.update(b';')
    return out.digest()


def _add(out, values):
    out.update(f'{values.dtype.str}{values.shape}'.encode())
    out.update(values.tobytes())


class Packed:
    """An attribute for a JSON document that grows with the night: kept as compressed text.

    As objects it would be ten times as large as that. Each reading makes a new document.
    """

    def __set_name__(self, owner, name):
        self._name = f'_packed_{name}'

    def __get__(self, owner, _=None):
        text = getattr(owner, self._name, None)
        return None if text is None else json.loads(zlib.decompress(text))

    def __set__(self, owner, document):
        text = None if document is None else zlib.compress(document_text(document).encode(), 1)
        setattr(owner, self._name, text)


def document_text(document):
    """As `json.dumps` of a dict, entry by entry: of a long text at once it makes as many pieces."""
    def of(value):
        if isinstance(value, list) and value:
            return f'[{", ".join(map(json.dumps, value))}]'
        return json.dumps(value)
    return f'{{{", ".join(f"{json.dumps(key)}: {of(value)}" for key, value in document.items())}}}'
