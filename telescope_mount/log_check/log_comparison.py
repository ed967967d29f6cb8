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

"""Compares a log with what is recomputed from it."""

import json
from collections import Counter

import numpy as np

#: rounding error relative to a number, or to the largest in its list, for messages and for
#: documents: another processor's sine differs in the last digit; fitted numbers, with another
#: numpy or scipy too, by what their iteration leaves (a sigma of a zero: 3e-9)
ROUNDING, FITTED = 1e-11, 1e-8


class LogComparison:
    """Counts comparisons, and keeps a line for each difference beyond rounding."""

    def __init__(self):
        self.checked, self.rounded = Counter(), 0
        self.differences = []
        self.unchecked = []

    def compare(self, kind, logged, computed, where):
        """Compare texts, or numbers."""
        self.checked[kind] += 1
        if isinstance(logged, str):
            same, close = same_document(logged, computed), same_but_for_rounding
        else:
            logged, computed = (np.asarray(v, dtype=float) for v in (logged, computed))
            same, close = np.array_equal(logged, computed, equal_nan=True), _close
        if same:
            return
        if close(logged, computed):
            self.rounded += 1
        else:
            self.differences.append(f'{kind} of {where}: {_difference(logged, computed)}')


#: entries of a document that repeat its numbers in words, which differ between versions
_WORDS = ('statement', 'text')


def same_document(logged, computed):
    """Whether two texts are equal; for documents, apart from their sentences."""
    if logged == computed or logged is None or computed is None:
        return logged == computed
    try:
        return _without_words(json.loads(logged)) == _without_words(json.loads(computed))
    except ValueError:
        return False


def same_but_for_rounding(logged, computed):
    """Whether two documents agree: numbers within `FITTED`, the rest exactly."""
    try:
        return _alike(*(_without_words(json.loads(text)) for text in (logged, computed)))
    except (TypeError, ValueError):
        return False


def _alike(a, b):
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(_alike(a[key], b[key]) for key in a)
    if isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        if all(isinstance(one, float) for one in (*a, *b)):
            return _close(np.array(a), np.array(b), FITTED)
        return all(map(_alike, a, b))
    if isinstance(a, float) and isinstance(b, float):
        return _close(np.array(a), np.array(b), FITTED)
    return a == b


def _close(a, b, part=ROUNDING):
    """Whether numbers agree within a fraction of the largest of them."""
    if a.shape != b.shape:
        return False
    size = np.max(np.abs(a[np.isfinite(a)]), initial=0.0)
    return np.allclose(a, b, rtol=0.0, atol=part * size, equal_nan=True)


def _without_words(value):
    if isinstance(value, dict):
        return {key: _without_words(one) for key, one in value.items() if key not in _WORDS}
    return [_without_words(one) for one in value] if isinstance(value, list) else value


def _difference(logged, computed):
    if isinstance(logged, str):
        try:
            return _first_difference(*(_without_words(json.loads(text))
                                       for text in (logged, computed or 'null')))
        except ValueError:
            return 'another text'
    return f'logged {logged.tolist()}, computed {computed.tolist()}'


def _first_difference(a, b, path=''):
    if isinstance(a, dict) and isinstance(b, dict):
        for key in [*a, *(k for k in b if k not in a)]:
            if key not in a or key not in b:
                return f'{path}{key} is only in one of them'
            if not _alike(a[key], b[key]):
                return _first_difference(a[key], b[key], f'{path}{key}.')
    if isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        for number, (one, other) in enumerate(zip(a, b)):
            if not _alike(one, other):
                return _first_difference(one, other, f'{path}{number}.')
    return f'{path.rstrip(".") or "document"}: logged {str(a)[:60]}, computed {str(b)[:60]}'
