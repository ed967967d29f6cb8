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

"""Pages of `close-the-loop`: for one night or run, and for many scenarios."""

from contextlib import suppress
from pathlib import Path

import numpy as np

from calibration.report import page_parts as page
from calibration.report.diagnosis_summary import effect_line
from calibration.report.drawing import limit_of
from calibration.report.error_ranking import errors_section
from calibration.report.page_html import body_of, whole
from calibration.report.provenance import provenance_section, site_text
from calibration.report.target_plot import target
from msg_tools.bag.bag_pair import parameters_of
from msg_tools.bag.sqlite import open_bag
from msg_tools.units import ARCSEC
from msg_tools.whole_files import write_text
from pointing_model.effects.base import arcsec, readable

from .loop_tables import added, effect_rows, loop_sentences

#: caption of the picture
_BLIND = ('Numbers: the same fresh stars by both models. Pictures: fresh stars pointed at by one '
          'model, as the camera saw them.')
_FILES = ('bag', 'observations.csv', 'model.json', 'report.json', 'diagnosis.json')


def write_loop_page(folder, report, run):
    """Write ``page.html`` of one night or run; it includes the page of its diagnosis.

    Parameters
    ----------
    folder : Path
        Folder of the night.
    report : dict
        Report of `closed_loop.close_the_loop`.
    run : PointingRun
        All rows.

    Raises
    ------
    OSError
        It cannot be written.
    """
    diagnosed = folder / 'diagnosis.html'
    diagnosis = diagnosed.read_text(encoding='utf-8') if diagnosed.is_file() else ''
    same = report['paired']
    before, after = (same[when]['rms_arcsec'] for when in ('before', 'after'))
    label = same['of']
    what = report['scenario'] or Path(str(report['source'])).name
    lines = sorted((effect_line(row, readable(row['name'])) for row in report['effects']),
                   key=lambda one: -(one.removes_arcsec or 0.0))
    headline = (f'Largest error: {lines[0].name}, {lines[0].size}. '
                if lines else '') + (
        f'{arcsec(after)} RMS on {label} with the new model, {arcsec(before)} with the old')
    alarms = [f'Alarm: {text}' for text in report['alarms']]
    params = {}
    with suppress(OSError, ValueError):
        params = parameters_of(open_bag(folder / 'bag').metadata, '/star_observer') or {}
    hits = _targets(report, run)
    body = [
        page.heading('The loop closed'),
        page.paragraph(f'{what} · verdict {report["verdict"]} · mount {run.mount.kind} · '
                       f'{len(run)} observations', 'meta'),
        page.controls(),
        page.verdict_section(headline, [
            page.cards([(before, f'before: {label}'), (after, f'after: {label}'),
                        (report['noise_floor_arcsec'], 'noise floor')]),
            hits and [page.paragraph(_BLIND, 'note'), hits], page.sentence_list(alarms)],
            report['verdict'].replace('_', ' '),
            'alarm' if report['alarms'] or report.get('found') in ('wrong', 'harmful') else ''),
        errors_section(lines, None if lines else page.paragraph(
            'None found: the model is unchanged.')),
        page.folded_section('Effects added', page.table(
            ('effect', 'coefficient', 'arcsec', 'σ', 'p', 'ΔBIC'),
            list(effect_rows(report['effects'])), 'numbers')),
        page.folded_section('Summary', page.sentence_list(
            loop_sentences({**report, 'notes': [], 'alarms': []}))),
        page.folded_section('RMS', page.bar_chart(
            _bars(report), report['noise_floor_arcsec'], 'noise floor')),
        page.folded_section('Diagnosis', body_of(diagnosis)),
        page.folded_section('Notes', page.sentence_list(
            [*report['notes'], 'Encoders and instruments: telescope-mount info bag --report '
             'night.html'])),
        provenance_section([
            ('scenario', report['scenario'] and f'{report["scenario"]} (simulated)'),
            ('run', report['source']), ('seed', str(report['seed'])), ('plan', report['plan']),
            ('site', site_text(params))], [folder / name for name in _FILES])]
    write_text(folder / 'page.html', whole(
        f'The loop closed: {what}', body, 'A pointing model, corrected and tested'))


def _bars(report):
    """All measures of the error, before and after."""
    rows, whens = [], ('before', 'after')
    if report['paired']['of'] == 'fresh stars':
        rows.append(('the same fresh stars', [
            (report['paired'][when]['rms_arcsec'], when, when) for when in whens]))
    for key, label in (('holdout_rms_arcsec', 'rows kept out'),
                       ('cv_rms_arcsec', 'cross-validated'), ('rms_arcsec', 'rows fitted')):
        rows.append((label, [(report[when].get(key), when, when) for when in whens]))
    return rows


def _targets(report, run):
    """Miss distances of the blind stars, before and after."""
    if 'check' not in run or 'miss_x' not in run or not report['blind_after']:
        return None
    blind = (run['check'] == 1.0) & np.isfinite(run['miss_x']) & np.isfinite(run['miss_y'])
    blocks = np.unique(run['block'][blind]) if 'block' in run else ()
    if len(blocks) < 2:
        return None
    hits = [np.array([run['miss_x'], run['miss_y']])[:, blind & (run['block'] == block)] / ARCSEC
            for block in (blocks[0], blocks[-1])]
    limit = limit_of(*hits)
    first, second = run.mount.names.axes
    axes = (f'{first} × cos {run.mount.names.letters[1]}', second)
    return page.figure_pair([target(axes, limit, *hit, f'{when}, seen by the camera', when)
                             for hit, when in zip(hits, ('before', 'after'))])


def write_all_page(folder, report):
    """Write ``page.html`` of many scenarios, with links to the page of each.

    Parameters
    ----------
    folder : Path
    report : dict
        Report of `close_the_loop.close_all`.

    Raises
    ------
    OSError
        It cannot be written.
    """
    rows, bars, good = [], [], 0
    for row in report['scenarios']:
        if 'error' in row:
            rows.append((row['scenario'], 'failed', row['error'], '', '', '', ''))
            continue
        good += row['found'] in ('yes', 'followed', 'in the set', 'rightly none')
        before, after = (row['paired'][when]['rms_arcsec'] for when in ('before', 'after'))
        name = row['scenario']
        rows.append((page.link(name, f'{name}/page.html'), row['verdict'],
                     ', '.join(added(row)) or None, row['found'], page.number(before),
                     page.number(after), page.number(row['noise_floor_arcsec'])))
        bars.append((row['scenario'], [(before, 'before', 'before'), (after, 'after', 'after')]))
    total = len(report['scenarios'])
    text = whole('The loop closed: all scenarios', [
        page.heading('The loop closed'),
        page.paragraph(f'{total} scenarios, seed {report["seed"]}', 'meta'),
        page.verdict_section(
            f'Correct result in {good} of {total} scenarios: error found, or rightly none',
            kind='' if good == total else 'alarm'),
        page.section('Each scenario', page.table(
            ('scenario', 'verdict', 'effects added', 'found', 'before ″', 'after ″', 'floor ″'),
            rows, 'sort'), 'The same fresh stars with the model before and after, radial RMS '
            'on the sky, arcsec.'),
        page.section('Before and after', page.bar_chart(bars)),
        provenance_section([('seed', str(report['seed']))], [folder / 'report.json'])],
        'Pointing models, corrected and tested')
    write_text(folder / 'page.html', text)
