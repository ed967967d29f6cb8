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

"""Terms of a model, their standard errors and correlations."""

from pathlib import PurePath

import numpy as np

from . import page_parts as page
from .number_wording import value_and_error

#: largest number of terms with a full correlation matrix; with more, strong pairs are listed
_DRAWN = 14


def terms_page_table(terms):
    """Terms with their standard errors.

    Parameters
    ----------
    terms : list of dict
        ``name, value, sigma, unit``; optionally ``alone``: the value without the effects.

    Returns
    -------
    Markup
    """
    alone = any(t.get('alone') is not None for t in terms)
    units = {t['unit'] for t in terms}
    each = len(units) > 1  # else the unit is in the header
    rows = []
    for t in terms:
        value, error = value_and_error(t['value'], t['sigma'])
        without = t.get('alone')
        rows.append([
            t['name'], value, 'undetermined' if t.get('undetermined') else error,
            page.number(abs(t['value'] / t['sigma']) if t['sigma'] else None, 1),
            *[None if without is None else value_and_error(without, t['sigma'])[0]] * alone,
            *[t['unit']] * each])
    return page.table(['term', 'value' + ''.join(f', {unit}' for unit in units) * (not each), 'σ',
                       '|value| / σ', *['without the effects'] * alone, *['unit'] * each],
                      rows, 'numbers terms', 'Terms of the model')


def run_terms_table(runs):
    """Terms fitted separately to each run."""
    names = list(dict.fromkeys(name for terms in runs.values() for name in terms))
    rows = [[PurePath(str(run)).name, *(page.number(terms.get(name), 2, True) for name in names)]
            for run, terms in runs.items()]
    return page.folded('Terms that each run fits for itself', page.table(
        ['run', *(f'{name} [arcsec]' for name in names)], rows, 'numbers'))


def correlation_table(names, matrix):
    """Correlations as coloured cells; with many terms the strong pairs only."""
    if matrix is None or len(names) < 2:
        return None
    matrix = np.asarray(matrix, float)
    if len(names) > _DRAWN:
        pairs = sorted(((abs(matrix[i, j]), names[i], names[j], matrix[i, j])
                        for i in range(len(names)) for j in range(i) if abs(matrix[i, j]) > 0.7),
                       reverse=True)
        rows = [[a, b, page.number(value, 3, True)] for _, a, b, value in pairs[:20]]
        return page.subsection('Correlations', page.table(
            ['term', 'term', 'correlation'], rows, 'numbers')
            if rows else page.paragraph('No correlation above 0.7.', 'note'))
    rows = [[page.numbered(i + 1, name),
             *(page.correlation(float(matrix[i, j]), i == j) for j in range(i + 1)),
             *[''] * (len(names) - 1 - i)] for i, name in enumerate(names)]
    return page.subsection('Correlations', page.table(
        ['', *map(str, range(1, len(names) + 1))], rows, 'correlations',
        'Correlations of the terms'))


def terms_section(rows, correlations=None, names=None, note='Encoder − catalogue, σ from the fit.',
                  more=None):
    """The section of a fit's terms.

    Parameters
    ----------
    rows : list of dict
        ``name``, ``value_arcsec``, ``sigma_arcsec``.
    correlations : array_like, optional
        Of `names` (by default the names in `rows`), or of the first of them.
    note : str
    more : part of a page
        Shown after the table.
    """
    terms = [{'name': row['name'], 'value': row['value_arcsec'], 'sigma': row.get('sigma_arcsec'),
              'undetermined': row.get('undetermined', False), 'unit': 'arcsec'}
             for row in rows or ()]
    names = names or [t['name'] for t in terms]
    shape = np.shape(correlations)
    if len(shape) != 2 or shape[0] != shape[1] or shape[0] > len(names):
        correlations = None
    else:
        names = names[:shape[0]]
    return page.section('Terms of the model', [terms_page_table(terms), more, page.folded(
        'Correlations', correlation_table(names, correlations))], note)
