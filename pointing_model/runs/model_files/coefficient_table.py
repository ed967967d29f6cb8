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

"""A model as CSV table, written and read: every coefficient with its formula.

Columns ``part, name, value_arcsec, sigma_arcsec, formula``. Rows of effects also name their drivers
(``follows``) and hold their definition as JSON (``made_of``), so nothing of the model is lost but
the correlations of its errors. Comments begin with ``#``; ``# geometry: ...`` and ``# errors: ...``
are read.
"""

import io
import json

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.fitted_effects import FittedEffect
from pointing_model.harmonics import COUNT, Harmonics
from pointing_model.model import PointingModel
from pointing_model.mounts import ALTAZ
from pointing_model.pointing_terms import terms_of
from pointing_model.runs.columns.cell_values import decimal_points
from pointing_model.runs.columns.cells import Cells, delimiter_of, safe_text, split_row, write_rows
from pointing_model.runs.columns.run_table import lines_of

from .program import number_of, refuse_equatorial

NAME, SUFFIX = 'table', '.csv'
_HEADER = ('part', 'name', 'value_arcsec', 'sigma_arcsec', 'formula', 'follows', 'made_of')


def write(model, caption):
    """Text of the table of a model."""
    out = io.StringIO()
    out.write(f'# {safe_text(" ".join(caption.split()))}\n# geometry: {model.geometry}\n'
              '# encoder - catalogue; (x, y): x = dA cos E and y = dE on the sky; A from north '
              'through east\n')
    if model.mount.on_sky:
        out.write(f'# errors: {model.mount.errors}\n# of a German mount: A and E are folded back '
                  'to the sky, before the side of the pier is worked out\n')
    rows = [_HEADER]
    for (name, value), error in zip(model.terms.items(), model.sigmas):
        rows.append(['term', name, repr(value / ARCSEC),
                     repr(float(error) / ARCSEC) if np.isfinite(error) else '',
                     terms_of(model.mount)[name].formula, '', ''])
    h = model.harmonics
    if h is not None:
        for name, (value, error) in h.coefficients.items():
            rows.append(['harmonic', name, repr(float(value / ARCSEC)),
                         repr(float(error / ARCSEC)), f'paper 000, E read as {h.interpretation}',
                         '', h.interpretation])
    for fitted in model.effects:
        e = fitted.effect
        made = json.dumps({'name': e.name, 'family': e.form, 'parameters': e.parameters})
        for name, value, error in zip(e.coefficient_names, fitted.coefficients, fitted.sigma):
            rows.append(['effect', name, repr(float(value / ARCSEC)),
                         repr(float(error / ARCSEC)), e.formula, ', '.join(e.requires), made])
    write_rows(out, rows)
    return out.getvalue()


def looks_like(text):
    """Whether a text is such a table."""
    top = next((line for line in text.splitlines() if line.strip() and not line.startswith('#')),
               '')
    names = split_row(top, delimiter_of(top)) or ()
    return 'value_arcsec' in names and 'name' in names


def read(path, text, mount=ALTAZ):
    """The model of a table.

    Parameters
    ----------
    path : Path or str
        For messages.
    text : str
    mount : Mount, optional

    Returns
    -------
    PointingModel

    Raises
    ------
    ValueError
        Unknown terms, numbers that are not finite, rows that do not fit.
    """
    geometry = 'rotation'
    lines = lines_of(path, text.encode())
    for number, line in enumerate(lines, 1):
        if line.startswith('#'):
            word, _, value = line[1:].partition(':')
            if word.strip() == 'geometry':
                geometry = value.strip()
                if geometry not in ('rotation', 'first_order'):
                    raise ValueError(f'{path}, row {number}: geometry {geometry!r} is neither '
                                     'rotation nor first_order')
            elif word.strip() == 'errors':
                mount = mount.with_errors(value.strip())
    cells = Cells(path, lines)
    for i in np.flatnonzero(cells.reasons != 0):  # an incomplete model is useless
        raise ValueError(f'{path}, row {cells.lines[i]}: {cells.reasons[i]}')
    columns = [decimal_points(cells.column(i)) for i in range(len(cells.header))]
    terms, errors, series, effects = {}, [], {}, {}
    for number, *texts in zip(cells.lines.tolist(), *columns):
        row = dict(zip(cells.header, texts))
        name, part = row['name'], row.get('part') or 'term'
        value = number_of(path, number, name, row['value_arcsec']) * ARCSEC
        error = number_of(path, number, f'sigma of {name}', row.get('sigma_arcsec') or '0') * ARCSEC
        if part == 'term':
            if name not in terms_of(mount):
                if mount.vertical:
                    refuse_equatorial(path, [name])
                raise ValueError(f'{path}, row {number}: {name} is no term that is known here; '
                                 f'known are {", ".join(terms_of(mount))}')
            if name in terms:
                raise ValueError(f'{path}, row {number}: {name} is there twice')
            terms[name] = value
            errors.append(error)
        elif part == 'harmonic':
            series[name] = value, error, row.get('made_of') or 'zenith'
        elif part == 'effect':
            effects.setdefault(row.get('made_of', ''), []).append((number, name, value, error))
        else:
            raise ValueError(f'{path}, row {number}: part {part!r} is none of term, harmonic, '
                             'effect')
    return PointingModel(terms, np.diag(np.square(errors)), _harmonics(path, series),
                         {'source': str(path), 'program': NAME}, geometry,
                         [_effect(path, made, rows) for made, rows in effects.items()], mount)


def _harmonics(path, series):
    if not series:
        return None
    values, errors = np.zeros((2, COUNT)), np.zeros((2, COUNT))
    for name, (value, error, _) in series.items():
        try:
            place = 'AB'.index(name[:1]), int(name[1:])
            values[place], errors[place] = value, error
        except (ValueError, IndexError):
            raise ValueError(f'{path}: {name} is no coefficient of the harmonics (A0 to '
                             f'B{COUNT - 1})') from None
    kind = next(iter(series.values()))[2]
    return Harmonics(kind, *values, np.diag(np.square(errors.ravel())))


def _effect(path, made, rows):
    number = rows[0][0]
    try:
        document = json.loads(made)
        return FittedEffect.from_document({**document, 'coefficients': [
            {'name': name, 'value_arcsec': value / ARCSEC, 'sigma_arcsec': error / ARCSEC}
            for _, name, value, error in rows]})
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(f'{path}, row {number}: not an effect that is known here: '
                         f'{error}') from None
