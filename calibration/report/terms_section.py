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

"""Terms of a model, their errors, and how they go together."""

import numpy as np

from .drawing import clean
from .page_parts import (
    Markup,
    folded,
    number,
    paragraph,
    section,
    subsection,
    table,
    value_and_error,
)

#: terms up to which every correlation is drawn; of more the strong pairs are listed
_DRAWN = 14


def terms_table(terms):
    """Terms with their standard errors.

    Parameters
    ----------
    terms : list of dict
        ``name, value, sigma, unit``; of some ``alone``: what it is without the effects.

    Returns
    -------
    str
        HTML.
    """
    alone = any(t.get('alone') is not None for t in terms)
    units = {t['unit'] for t in terms}
    each = len(units) > 1  # else the unit is in the header
    rows = [[t['name'], value_and_error(t['value'], t['sigma'])[0],
             'undetermined' if t.get('undetermined')
             else value_and_error(t['value'], t['sigma'])[1],
             number(abs(t['value'] / t['sigma']), 1) if t['sigma'] else '–',
             *([value_and_error(t['alone'], t['sigma'])[0] if t.get('alone') is not None else '–']
               if alone else []), *[t['unit']] * each] for t in terms]
    return table(['term', 'value' + ''.join(f', {unit}' for unit in units) * (not each), 'σ',
                  '|value| / σ', *['without the effects'] * alone, *['unit'] * each],
                 rows, 'numbers terms', 'Terms of the model')


def correlation_table(names, matrix):
    """Correlations as coloured cells; of many terms only the strong pairs."""
    if matrix is None or len(names) < 2:
        return ''
    matrix = np.asarray(matrix, float)
    if len(names) > _DRAWN:
        pairs = [(abs(matrix[i, j]), names[i], names[j], matrix[i, j])
                 for i in range(len(names)) for j in range(i) if abs(matrix[i, j]) > 0.7]
        rows = [[a, b, number(value, 3, True)] for _, a, b, value in sorted(pairs, reverse=True)]
        return subsection('Correlations', table(
            ['term', 'term', 'correlation'], rows[:20], 'numbers')
            or paragraph('No correlation above 0.7.', 'note'))
    rows = []
    for i, name in enumerate(names):
        cells = [Markup(f'<b>{i + 1}</b>\u2002{clean(name)}')]
        for j in range(i + 1):
            value = float(matrix[i, j])
            strength = min(abs(value), 1.0) if i != j else 0.0
            colour = '213,94,0' if value > 0 else '0,114,178'
            cells.append(Markup(f'<span class="corr" style="background:rgba({colour},'
                                f'{0.75 * strength**1.5:.2f})">{number(value)}</span>'))
        rows.append(cells + [''] * (len(names) - 1 - i))
    return subsection('Correlations', table(
        ['', *map(str, range(1, len(names) + 1))], rows, 'correlations',
        'Correlations of the terms'))


def terms_section(rows, correlations=None, names=None, note='Encoder − catalogue, σ from the fit.',
                  more=''):
    """The section of a fit's terms.

    Parameters
    ----------
    rows : list of dict
        ``name``, ``value_arcsec``, ``sigma_arcsec``.
    correlations : array_like, optional
        Of `names`, by default the names in `rows`, or of the first of them.
    note : str
    more : str
        HTML at the end.
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
    return section('Terms of the model', terms_table(terms), more, folded(
        'Correlations', correlation_table(names, correlations)), note=note)
