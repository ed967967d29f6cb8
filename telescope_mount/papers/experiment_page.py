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

"""The page of `experiment`: the nights of paper 000, the satellite, and causes of the zeros."""


import numpy as np

from calibration.analysis.term_fit import fit_terms
from calibration.analysis.zero.zero_causes import COVARIATES
from calibration.analysis.zero.zero_season import season_from_rows
from calibration.report import page_parts as page
from calibration.report.drawing import Panel, limit_of, svg
from calibration.report.error_ranking import ErrorLine, errors_section
from calibration.report.page_html import whole
from calibration.report.provenance import provenance_section
from calibration.report.residual_figures import controls, residual_sections, sky_maps
from calibration.report.residuals import run_residuals
from calibration.report.zero_season_report import season_lines
from calibration.report.zero_wording import COVARIATES as WORDS
from calibration.rows import for_fitting
from msg_tools.units import ARCSEC
from pointing_model.zero import PowerOnZero, is_for_zero

AXES = (('az', 'azimuth'), ('el', 'elevation'))
WHENS = ('before', 'after')


def render_experiment(report, run=None, files=()):
    """The page as text.

    Parameters
    ----------
    report : dict
        Result of `experiment.run_experiment`.
    run : PointingRun, optional
        All rows of all nights.
    files : iterable of Path
        Files written with it.
    """
    table1, summary, paper = (report['table1'], report['statistics'], report['paper'])
    radial = {when: _radial(summary, when) for when in WHENS}
    printed = _radial(paper['statistics'], 'after')
    single = float(np.sqrt(np.mean([
        night['physical']['after']['radial_rms_arcsec']**2 for night in report['nights']])))
    bars = [(f'{name}, {when}', [(one[f'{when}_{axis}_arcsec']['rms'], kind, label)
                                 for one, kind, label in ((summary, when, 'here'),
                                                         (paper['statistics'], 'floor', 'paper'))])
            for axis, name in AXES for when in WHENS]
    what = f'scenario {report["scenario"]}' if 'scenario' in report else \
        f'drifts: {report.get("drifts")}'
    case = report.get('case_1_1')
    lines = [f'Alarm: {text}' for text in report['alarms'][:8]]
    if case:
        lines.append(f'One more night: Polaris is {case["polaris_off_arcsec"]:.1f}″ off its place, '
                     f'above the specified {case["specification_arcsec"]:g}″. Its stars: '
                     f'{case["before_rms_arcsec"]:.2f}″ RMS before the zero is set, '
                     f'{case["after_rms_arcsec"]:.2f}″ after.')
    data = None if run is None else residuals_of_nights(report, run)
    body = [
        page.heading('Nights with the model of two nights before'),
        page.paragraph(
            f'{len(table1)} nights · seed {report.get("seed")} · {what} · simulated', 'meta'),
        page.controls() if data is None else controls(data),
        page.verdict_section(
            f'Mean of each night’s stars: {radial["after"]:.2f}″ RMS after the zero is set, '
            f'{radial["before"]:.2f}″ before', [
                page.cards([(radial['before'], 'before the zero is set'),
                            (radial['after'], 'after'), (single, 'after, a single star'),
                            (printed, 'after, in the paper (11 nights)')]),
                page.figure_pair([_nights(table1, axis, name, 'after') for axis, name in AXES]),
                page.sentence_list(lines)], kind='alarm' if report['alarms'] else ''),
        errors_section(_largest(summary)),
        page.section('Nights', _table(report)),
        page.folded_section('Axes', [page.bar_chart(bars), page.figure_pair(
            [_nights(table1, axis, name, 'before') for axis, name in AXES])]),
        page.folded_section('Over all nights', _statistics(summary, paper['statistics'])),
        *([] if data is None else [page.folded_section('Residuals on the sky', sky_maps(data)),
                                   *residual_sections(data)]),
        _satellite(report), _zeros(report['zeros']),
        provenance_section([('seed', str(report.get('seed'))), ('what the simulator does', what)],
                           files)]
    return whole('Nights with the model of two nights before', body, 'Experiment of paper 000')


def _largest(summary):
    """The zero of each axis as an error, the larger first."""
    lines = []
    for axis, name in AXES:
        before, after = (summary[f'{when}_{axis}_arcsec']['rms'] for when in WHENS)
        lines.append(ErrorLine(
            f'Zero of the {name} encoder, from night to night', None,
            float(np.sqrt(max(before**2 - after**2, 0.0))),
            ['incremental encoders count from where they were switched on'],
            'set the zero on Polaris at the begin of each night'))
    return sorted(lines, key=lambda one: -one.removes_arcsec)


def _radial(statistics, when):
    """RMS of both axes combined, arcsec."""
    return float(np.hypot(*(statistics[f'{when}_{axis}_arcsec']['rms'] for axis, _ in AXES)))


def residuals_of_nights(report, run):
    """Residuals of every star from the model of two nights before, with its zero and tonight's.

    Parameters
    ----------
    report : dict
    run : PointingRun

    Returns
    -------
    Residuals or None
        The means of its rows before and after Polaris equal those of the report.
    """
    parts = []
    for night in report['nights']:
        summary = night['physical']
        zero = np.array([summary['zero'][f'{axis}_arcsec'] for axis, _ in AXES]) * ARCSEC
        then = zero - np.array([summary[f'change_{axis}_arcsec'] for axis, _ in AXES]) * ARCSEC
        reference = for_fitting(run.select(run['run'] == night['reference']))
        rows = run.select((run['run'] == night['night']) & (run['star'] >= 0))
        rows = rows.select(~is_for_zero(rows))
        if not len(rows) or not len(reference):
            continue
        model = fit_terms(reference, zero=PowerOnZero(*then)).model
        parts.append((rows, *(np.array(model.residuals(rows, zero=PowerOnZero(*one))) / ARCSEC
                              for one in (then, zero))))
    if not parts:
        return None
    rows = type(run).concatenate([part[0] for part in parts])
    before, after = (np.concatenate([part[i] for part in parts], axis=1) for i in (1, 2))
    return run_residuals(
        rows, [f'HIP {star:.0f}' for star in rows['star']], before, after,
        np.ones(len(rows), bool), ['for validation, not fitted'] * len(rows), group_word='night',
        before_text='model of two nights before, zero of then',
        after_text='the same model, zero of tonight')


def _key(night):
    return f'n{night}'


def _nights(rows, axis, name, when):
    """Mean errors of the nights, with a common scale for before and after of an axis."""
    x = np.array([row['night'] for row in rows], float)
    y = np.array([row[f'{when}_{axis}_arcsec'] for row in rows])
    limit = limit_of(y)
    panel = Panel((52, 26, 378, 150), (x.min() - 0.7, x.max() + 0.7), (-limit, limit))
    panel.axes('night', 'arcsec', f'{name}, {when}')
    panel.points(x, y, f'{when} big', keys=[_key(row['night']) for row in rows])
    label = f'{name}, {when}: mean {np.mean(y):+.2f}, RMS {np.sqrt(np.mean(y**2)):.2f} arcsec'
    return page.figure(svg(446, 224, panel.parts, label, 'link'), when=when)


def _table(report):
    by_night = {row['night']: row for row in report['nights']}
    rows, keys = [], []
    for row, printed in zip(report['table1'], report['paper']['table1'] + [None] * len(
            report['table1'])):
        after = by_night[row['night']]['physical']['after']
        keys.append(_key(row['night']))
        rows.append((row['night'], *(page.number(row[f'{when}_{axis}_arcsec'], 2, True)
                                     for when in WHENS for axis, _ in AXES),
                     *(page.number(after.get(f'{axis}_sigma_arcsec'), 2) for axis, _ in AXES),
                     page.number(after['radial_rms_arcsec']), after['stars'],
                     *(page.number(printed and printed[f'{when}_{axis}_arcsec'], 1, True)
                       for when in WHENS for axis, _ in AXES)))
    head = ['night', *(f'{when} {name} ″' for when in WHENS for _, name in AXES),
            *(f'± {name} ″' for _, name in AXES), 'stars after, radial RMS ″', 'stars',
            *(f'paper: {when} {name} ″' for when in WHENS for _, name in AXES)]
    return page.table(head, rows, 'stars sort', 'Mean errors of the stars of each night', keys)


def _statistics(ours, paper):
    rows = [(f'{name}, {when}', *(page.number(one[f'{when}_{axis}_arcsec'][key])
                                  for one in (ours, paper) for key in ('mean', 'std', 'rms')))
            for when in WHENS for axis, name in AXES]
    return page.table(('arcsec', 'mean', 'std', 'RMS', 'paper: mean', 'std', 'RMS'), rows,
                      'numbers')


def _satellite(report):
    """The satellite tracked before and after the zero calibration."""
    tracks, ours = report.get('satellite'), report.get('gps')
    if not tracks or not ours:
        return None
    drawn = []
    for when in WHENS:
        minutes = (np.asarray(tracks[when]['time']) - np.min(tracks[when]['time'])) / 60.0
        for axis, name in AXES:
            error = np.asarray(tracks[when][f'{axis}_arcsec'])
            limit = limit_of(error)
            panel = Panel((52, 26, 378, 120), (minutes.min() - 0.2, minutes.max() + 0.2),
                          (-limit, limit))
            panel.axes('minutes', 'arcsec', f'{name}, {when}')
            panel.points(minutes, error, when)
            drawn.append(page.figure(svg(446, 194, panel.parts, f'Satellite, {name}, {when}'),
                                     when=when))
    rows = [(f'{name}, {when}', *(page.number(one[when].get(f'{axis}_{key}_arcsec'))
                                  for one in (ours, ours['paper']) for key in ('mean', 'std')))
            for when in WHENS for axis, name in AXES]
    return page.folded_section('A GPS satellite, before and after the zero calibration', [
        page.figure_pair(drawn[:2]), page.figure_pair(drawn[2:]), page.table(
            ('arcsec', 'mean', 'std', 'paper: mean', 'paper: std'), rows, 'numbers')])


def _zeros(summary):
    """Zeros of the power-ons as a function of the measurements at the mark."""
    if not summary['power_ons']:
        return None
    found, season = summary['causes'], season_from_rows(summary['power_ons'])
    drawn = []
    for name in found['drivers'] or ['temperature']:
        words, (unit, _) = WORDS[name], COVARIATES[name]
        for k, (_, label) in enumerate(AXES):
            values, zeros = season.covariates[name][:, k], season.zeros[:, k] / ARCSEC
            good = np.isfinite(values) & np.isfinite(zeros)
            if not good.any():
                continue
            x, y, margin = values[good], zeros[good], 0.05 * max(float(np.ptp(values[good])), 1e-3)
            pad = 0.1 * max(float(np.ptp(y)), 1.0)
            panel = Panel((56, 26, 374, 150), (x.min() - margin, x.max() + margin),
                          (y.min() - pad, y.max() + pad))
            state = found['axes'][label]['verdict']
            panel.axes(f'{words} [{unit}]', 'zero ″', ': '.join(filter(None, (label, state))))
            panel.bars(x, y, season.sigmas[good, k] / ARCSEC, 'before')
            panel.points(x, y, 'before')
            cause = next((c for c in found['axes'][label]['causes']
                          if c['driver'] == name), None)
            if cause:
                ends = np.array([x.min(), x.max()])
                level = np.mean(y - cause['slope_arcsec'] * x)
                panel.line(ends, level + cause['slope_arcsec'] * ends, 'fit')
            drawn.append(page.figure(svg(446, 224, panel.parts,
                                         f'Zero of the {label} against {words}')))
    tonight, rows = summary['tonight'], []
    for _, name in AXES:
        one = tonight and tonight[name]
        if one:
            rows.append((name, page.number(one['expected_arcsec'], 1, True),
                         page.number(one['sigma_arcsec'], 1),
                         page.number(one['measured_arcsec'], 1, True),
                         page.number(one['measured_sigma_arcsec'], 1)))
    predicted = page.subsection('The last power-on, predicted before Polaris was seen', page.table(
        ('axis', 'predicted ″', '± ″', 'measured ″', '± ″'), rows, 'numbers'))
    return page.folded_section('What the zeros of the power-ons follow', [
        page.sentence_list(season_lines(summary)), page.figure_pair(drawn), predicted],
        'Zero since the first power-on, against what was measured at the mark.')
