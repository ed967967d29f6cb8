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

"""Terminal output of `close-the-loop`."""

from textwrap import shorten

from calibration.report.number_wording import number
from calibration.report.terminal_tables import decimals, new_table
from pointing_model.effects.base import readable
from pointing_model.mount_kinds import kind_of

#: characters of an alarm in the table of all scenarios
_ALARM = 36
#: effects listed by name
_EFFECTS = 4
#: fraction of the squared misses from which the drive is mentioned
_DRIVE = 0.25


def _rms(entry):
    return [decimals(entry[f'rms_{part}arcsec']) for part in ('x_', 'y_', '')]


def loop_tables(report):
    """Tables for one night or run.

    Parameters
    ----------
    report : dict
        Report of `closed_loop.close_the_loop`.

    Returns
    -------
    list of rich.table.Table
    """
    return [_effects(report), _errors(report)]


def short_tables(report):
    """The effects by name, and the error before and after on the same data: texts and a table.

    Parameters
    ----------
    report : dict
        Report of `closed_loop.close_the_loop`.

    Returns
    -------
    list
    """
    effects = report['effects']
    lines = [f'verdict: {report["verdict"]}', *(
        f'{i}. {readable(effect["name"])}: RMS removed {number(effect["removes_rms_arcsec"])}″'
        for i, effect in enumerate(effects[:_EFFECTS], 1))]
    if effects[_EFFECTS:]:
        lines.append(f'{len(effects) - _EFFECTS} smaller effects')
    lines += [f'not published: {", ".join(map(readable, entry["effects"]))}'
              for entry in report['refused'][:1]]
    if not effects and not report['refused']:
        lines.append('nothing significant; the model stays as it was')
    lines += [_follows(axis) for axis in report['follows']]
    same = report['paired']
    rows = '' if same['rows'] is None else f'{same["rows"]} '
    table = new_table('', f'RMS, arcsec, {rows}{same["of"]}', *kind_of(report).columns, 'radial')
    for when in ('before', 'after'):
        table.add_row(f'model {when}', *_rms(same[when]))
    table.add_row('noise floor', '', '', decimals(report['noise_floor_arcsec']))
    return [*lines, table]


def effect_rows(effects):
    """Table cells of the effects of a diagnosis, a tuple of str for each coefficient."""
    for effect in effects:
        called, gain = readable(effect['name']), number(effect['delta_bic'], 1)
        p = '–' if effect['p_family'] is None else f'{effect["p_family"]:.2g}'
        for name, value in effect['coefficients_arcsec'].items():
            yield (called, name, number(value, 2, True), number(effect['sigma_arcsec'][name]), p,
                   gain)
            called = p = gain = ''


def _effects(report):
    table = new_table(f'Verdict: {report["verdict"]}', 'effect', 'coefficient', 'arcsec', 'sigma',
                      'p', 'ΔBIC')
    for cells in effect_rows(report['effects']):
        table.add_row(*cells)
    for entry in report['refused']:
        table.add_row(', '.join(map(readable, entry['effects'])), 'not published', '', '', '', '')
    for axis in report['follows']:
        table.add_row(_follows(axis), '', '', '', '', '')
    if not report['effects'] and not report['refused']:
        table.add_row('nothing significant; the model stays as it was', '', '', '', '', '')
    return table


def _follows(axis):
    return f'zero of the {axis} encoder: tracked by the absolute encoder'


def _errors(report):
    table = new_table('RMS on the sky, arcsec', '', *kind_of(report).columns, 'radial', 'rows')
    same = report['paired']
    if same['of'] == 'fresh stars':
        for when in ('before', 'after'):
            table.add_row(f'the same fresh stars, model {when}', *_rms(same[when]),
                          str(same['rows']))
    for name, key, count in (('rows kept out', 'holdout_rms_arcsec', str(report['kept_out'])),
                             ('cross-validated', 'cv_rms_arcsec', '')):
        for when in ('before', 'after'):
            table.add_row(f'{name}, {when}', '', '', decimals(report[when][key]), count)
    for when in ('before', 'after'):
        table.add_row(f'rows fitted, {when}', *_rms(report[when]), '')
    for when in ('before', 'after'):
        check = report[f'blind_{when}']
        if check is not None:
            count = f'{check["stars"]}' + (f' + {check["lost"]} lost' if check['lost'] else '')
            table.add_row(f'different stars, pointed blind, {when}', *_rms(check), count)
    table.add_row('noise floor', '', '', decimals(report['noise_floor_arcsec']), '')
    return table


def loop_sentences(report):
    """Sentences besides the tables, list of str."""
    out = []
    for effect in report['effects']:
        others = [name for name in effect['alternatives'] if name not in effect['aliases']]
        if others:
            out.append(f'{readable(effect["name"])} was added; this night cannot distinguish it '
                       'from ' + ', '.join(map(readable, others)))
        if effect['aliases']:
            out.append(f'{readable(effect["name"])} is the same curve in this night as '
                       + ', '.join(map(readable, effect['aliases'])))
    if report['judged'] is not None:
        out.append('fresh stars: ' + report['judged']['why'])
    drive = report.get('drive')
    if drive and drive['rms_arcsec'] ** 2 > _DRIVE * drive['missed_arcsec'] ** 2:
        first, second = kind_of(report).axes
        out.append(f'fresh stars: {drive["missed_arcsec"]:.2f} arcsec RMS; drive error by '
                   f'the encoders {drive["rms_arcsec"]:.2f} ({first} {drive["rms_x_arcsec"]:.2f}, '
                   f'{second} {drive["rms_y_arcsec"]:.2f}). No model removes it: '
                   'check servo, friction and wind')
    scenario = report.get('undeclared')
    if scenario:
        out.append(f'the scenario: {scenario["what"]}')
        if report['found']:
            out.append(f'found: {report["found"]}'
                       + ('; besides: ' + ', '.join(map(readable, report['false']))
                          if _besides(report) else ''))
    return out + report['notes'] + [f'encoder cross-check: {alarm}' for alarm in report['alarms']]


def all_table(report):
    """One table of all scenarios; `report` is that of `close_the_loop.close_all`."""
    names = ['scenario', 'verdict', 'effects added', 'found', 'before', 'after', 'floor']
    alarms = any(row.get('alarms') for row in report['scenarios'])
    table = new_table('The same fresh stars with the model before and after, radial RMS on the '
                      'sky, arcsec', *names, *['alarms'] * alarms)
    for row in report['scenarios']:
        if 'error' in row:
            table.add_row(row['scenario'], 'failed', row['error'])
            continue
        found = row['found'] or ''
        if _besides(row):
            found += f', {len(row["false"])} besides'
        table.add_row(
            row['scenario'], row['verdict'], '\n'.join(added(row)) or '–', found,
            *(decimals(row['paired'][when]['rms_arcsec']) for when in ('before', 'after')),
            decimals(row['noise_floor_arcsec']), *[_alarms(row)] * alarms)
    return table


def added(report):
    """Additions of the diagnosis to the model, list of str for people."""
    return [*map(readable, report['applied']), *map(_follows, report['follows'])]


def _besides(report):
    """Whether there are effects besides the expected ones; if none is expected, false."""
    return report['false'] and report['found'] not in ('wrong', 'unknown')


def _alarms(row):
    """Beginning of each cross-check alarm: axis, which encoder moved, and how."""
    return '\n'.join(shorten(alarm, _ALARM, placeholder=' …') for alarm in row['alarms'])
