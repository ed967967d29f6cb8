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

"""Terminal tables used by several commands: terms, harmonics, a base model."""

from itertools import zip_longest

from ..analysis.harmonic_fit import READ_AS
from .fit_wording import UNDETERMINED
from .terminal_layout import TerminalTable

#: largest number of terms listed in one column
_ONE_COLUMN = 8


def new_table(title, *columns):
    """An empty table, first column left-aligned, the others right; see `terminal_layout`."""
    out = TerminalTable(title=title)
    for i, name in enumerate(columns):
        out.add_column(name, justify='left' if i == 0 else 'right')
    return out


def decimals(value, digits=2):
    """A number for a table; a dash if unknown."""
    return '-' if value is None else f'{value:.{digits}f}'


def terms_table(terms):
    """A table of terms with their standard errors.

    Parameters
    ----------
    terms : list of dict
        With ``name``, ``value_arcsec``, ``sigma_arcsec``, and ``within95_arcsec`` if rows are few.

    Returns
    -------
    rich.table.Table
    """
    wide = any('within95_arcsec' in term for term in terms)
    heads = ['arcsec', 'sigma', *(['95 % within'] * wide)]
    cells = []
    for term in terms:
        sigma, within = term['sigma_arcsec'], term.get('within95_arcsec')
        cells.append([term['name'], f'{term["value_arcsec"]:+.2f}',
                      UNDETERMINED if sigma is None else f'{sigma:.2f}',
                      *(['–' if within is None else f'± {within:.2f}'] if wide else ())])
    if len(terms) <= _ONE_COLUMN:
        out = new_table('', 'term, encoder − catalogue', *heads)
        for row in cells:
            out.add_row(*row)
        return out
    out, half = new_table('', 'encoder − catalogue', *heads, 'term', *heads), -(-len(cells) // 2)
    for left, right in zip_longest(cells[:half], cells[half:], fillvalue=[''] * (1 + len(heads))):
        out.add_row(*left, *right)
    return out


def harmonic_tables(section):
    """Tables of the harmonic coefficients, and of the cross-validated RMS of all choices.

    Parameters
    ----------
    section : dict
        From `calibration.analysis.harmonic_fit.fit_chosen`.

    Returns
    -------
    list of rich.table.Table
    """
    own = section['harmonics'], section['alone'], section['degree']
    table = new_table(f'Harmonics of degree {own[2]}, {READ_AS[own[0]]}, arcsec', 'coefficient',
                      'azimuth', 'sigma', 'coefficient', 'elevation', 'sigma')
    rows = section['coefficients']
    for pair in zip(rows, rows[len(rows) // 2:]):
        table.add_row(*(cell for one in pair for cell in (
            one['name'], f'{one["value_arcsec"]:+.2f}',
            UNDETERMINED if one['sigma_arcsec'] is None else f'{one["sigma_arcsec"]:.2f}')))
    tried = section['cross_validation']
    choices = new_table(f'Cross-validated RMS on the sky, arcsec, {tried["stars"]} rows in '
                        f'{tried["folds"]} folds', 'model', 'az', 'el', 'radial', '')
    for one in tried['choices']:
        chosen = (one['harmonics'], one['alone'], one['degree']) == own
        choices.add_row(one['label'], *rms_cells(one),
                        f'chosen by {section["degree_by"]}' if chosen else '')
    return [table, choices]


def rms_cells(values):
    return [f'{values[key]:.2f}' for key in ('x', 'y', 'radial')]


def base_table(base, model):
    """Table of the terms of a `base_model.BaseModel`, from its file and as fitted here."""
    out = new_table(f'Terms of {base.path.name} and of this run, arcsec', 'term', 'there',
                    'here', 'sigma', 'here - there', 'in sigma')
    for row in base.compared(model)['terms']:
        there, here, sigma, many = (row[k] for k in (
            'there_arcsec', 'here_arcsec', 'sigma_arcsec', 'in_sigma'))
        out.add_row(row['name'], f'{there:+.2f}', *(['-'] * 4 if here is None else [
            f'{here:+.2f}', UNDETERMINED if sigma is None else f'{sigma:.2f}',
            f'{here - there:+.2f}',
            '-' if many is None else f'{many:+.1f}']))
    return out
