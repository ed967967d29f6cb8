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

"""Words for the raw error: its largest terms, and the tilt of the first axis."""

import numpy as np

from pointing_model.effects.base import arcsec, readable
from pointing_model.mount_kinds import kind_of

_MUCH = 3.0  # smallest ratio of raw to residual RMS at which the raw error is described
_PART, _MOST_NAMED = 0.3, 2  # smallest share of a named term, and largest number of them
_MOST_MOVED, _RESEMBLES = 3, 0.7  # largest number of changed terms; smallest reported correlation


def raw_error_sentence(document):
    """Composition of the raw error, and the tilt of the first axis; '' if the error is small.

    Parameters
    ----------
    document : dict
        With ``as_read_rms_arcsec``, ``as_read_terms``, ``before``, ``mount`` and ``equinox``.

    Returns
    -------
    str
    """
    read, rows = document.get('as_read_rms_arcsec'), document.get('as_read_terms') or []
    left = document['before'].get('rms_arcsec')
    if not rows or not read or left is None or read < _MUCH * left:
        return ''
    names = kind_of(document)
    values = {names.terms[row['name']][0]: row for row in rows if row['name'] in names.terms}
    others = [row for row in values.values() if row['rms_arcsec'] > _PART * read][:_MOST_NAMED]
    sentences = [f'The raw error is mostly {_named(others, names)}'] if others else []
    more = _beyond_zeros(values, others, left)
    lean = '' if any(values[own].get('undetermined') for own in ('AN', 'AW') if own in values) \
        else _lean(values, names, document.get('south', False))
    if any(names.terms[row['name']][0] not in ('AN', 'AW') or not lean for row in more):
        sentences.append(f'Beyond the zeros: {_named(more, names, sizes=True)}')
    if lean:
        sentences.append(f'The {names.shafts[0]} {lean}{_if_so(document, values, names)}')
    if sentences:
        sentences += _of_which_fit(document, rows)
    return '. '.join(sentences) + '.' if sentences else ''


def _named(rows, names, sizes=False):
    terms = [f'{row["name"]} {_signed(row["value_arcsec"])} '
             f'({_what(row["name"], names)}'
             + ', undetermined: the sum of several terms' * row.get('undetermined', False)
             + f'; {arcsec(row["rms_arcsec"])} RMS on the sky' * sizes + ')' for row in rows]
    return ' and '.join(filter(None, [', '.join(terms[:-1]), terms[-1]]))


def _beyond_zeros(values, named, left):
    """Further terms that are a large part of the raw error without the zeros."""
    rows = {own: row for own, row in values.items() if own not in ('IA', 'IE')}
    size = np.sqrt(sum(row['rms_arcsec']**2 for row in rows.values()))
    return [row for row in rows.values() if row not in named
            and row['rms_arcsec'] > max(_PART * size, left)]


def _of_which_fit(document, rows):
    """Sentences on the fit that gave these values, and on terms that change with the effects."""
    effects = len(document['effects'])
    if not effects or document['before'] == document['after']:
        return []
    sentences = [f'Values from the fit of the {len(document["base_terms"])} terms alone']
    moved = sorted((row for row in rows if 'beside_effects_arcsec' in row),
                   key=lambda row: -abs(row['beside_effects_arcsec'] - row['value_arcsec']))
    changes = []
    for row in moved[:_MOST_MOVED]:
        text = (f'{row["name"]} from {_signed(row["value_arcsec"])} to '
                f'{_signed(row["beside_effects_arcsec"])}')
        if abs(row.get('correlation') or 0.0) > _RESEMBLES:
            text += (f' (correlated with {readable(row["resembles"])}, r = '
                     f'{row["correlation"]:.2f})').replace('-', '\u2212')
        changes.append(text)
    if changes:
        correlation = document.get('wander')
        # then the fit with effects models correlated noise, and that of the terms alone absorbs it
        beside = ' and correlated noise' * bool(
            correlation and correlation.get('along_the_sky') is None)
        sentences.append(f'With the effect{"s" * (effects > 1)}{beside} the terms change: '
                         f'{". ".join(changes)}')
    return sentences


def _if_so(document, values, names):
    """The assumed equinox of the catalogue, and the axis with the other one, if undetermined."""
    found = document.get('equinox')
    if not found or found['told']:
        return ''
    polar, taken, other = found['polar_axis_arcsec'], found['taken'], found['other']
    out = f', if the catalogue of the file is {taken} (undetermined)'
    if {taken, other} <= set(polar):
        by = {name: polar[other][name] - value for name, value in polar[taken].items()}
        moved = {own: {**row, 'value_arcsec': row['value_arcsec'] + by.get(row['name'], 0.0)}
                 for own, row in values.items()}
        out += f'. If it is {other}, it {_lean(moved, names, document.get("south", False))}'
    return f'{out}. Say which with --equinox before the axis is moved'


def _what(name, names):
    """A geometric term in words."""
    own = names.terms[name][0]
    cone = ', the cone error' if names.axes[0] == 'hour angle' else ''
    return {'IA': f'zero of the {names.axes[0]}', 'IE': f'zero of the {names.axes[1]}',
            'CA': f'collimation{cone}', 'NPAE': 'the axes are not square',
            'TF': 'tube flexure', **dict.fromkeys(('AN', 'AW'), 'the tilt of the '
                                                    f'{names.shafts[0]}')}[own]


def _lean(values, names, south):
    """Size and direction of the tilt of the first axis; '' if unknown."""
    if not {'AN', 'AW'} <= set(values) or names.axes[0] not in ('azimuth', 'hour angle'):
        return ''
    north, west = (values[own]['value_arcsec'] for own in ('AN', 'AW'))
    west *= names.terms[values['AW']['name']][1]
    terms = [values[own]['name'] for own in ('AN', 'AW')]
    if names.axes[0] == 'azimuth':
        ways = (('north', 'south')[north < 0.0], ('west', 'east')[west < 0.0])
        text = 'tilts {} to the {} ({}) and {} to the {} ({})'
    else:
        # for the end above the horizon; the sign of MA refers to the pole itself
        north, west = (-one if south else one for one in (north, -west))
        ways = (('high', 'low')[north < 0.0], ('west', 'east')[west < 0.0])
        text = 'points {} too {} ({}) and {} {} of the pole ({})'
    return text.format(_size(north), ways[0], terms[0], _size(west), ways[1], terms[1])


def _size(value):
    """An angle in arcsec, or in arcmin from 100 arcsec on."""
    value = abs(value)
    return f'{value / 60.0:.1f}\u2032' if value >= 100.0 else f'{value:.0f}\u2033'


def _signed(value):
    return f'{value:+.0f}\u2033'.replace('-', '\u2212')
