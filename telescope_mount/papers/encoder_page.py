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

"""The page of `encoder-test`: 23 angles, read by each method."""


import numpy as np

from calibration.report import page_parts as page
from calibration.report.drawing import Panel, limit_of, svg
from calibration.report.error_ranking import ErrorLine, errors_section
from calibration.report.page_html import whole
from calibration.report.provenance import provenance_section
from pointing_model.effects.base import arcsec

from .encoder_test import PRINTED_STD, notes

#: method -> style of its curve: colour and mark
STYLES = {'centroid': 'before', 'parabola': 'fit', 'paper': 'after', 'template': 'third'}
_MARKS = {'before': 'dots', 'fit': 'crosses', 'after': 'squares', 'third': 'triangles'}
#: methods of the paper, and the causes of their errors
_NAMES = {'centroid': 'Centroid of one bar', 'paper': 'Phase fit of the paper',
          'parabola': 'Parabola through each bar'}
_CAUSES = {
    'centroid': 'one bar alone; noise at its edges decides which pixels count',
    'paper': 'bars cut at the ends of the row falsify the fitted period',
    'parabola': 'the phase is read at pixel 0, at the end of the line through the bars'}
#: arcsec: an error above this is a whole bar, and would flatten the other curves
_GROSS = 600.0


def render_encoder_test(report, files=()):
    """The page as text.

    Parameters
    ----------
    report : dict
        Report of `encoder_test.run`.
    files : iterable of Path
        Files written with it.
    """
    conditions, methods = report['conditions'], report['methods']
    loud = report['noise_of_the_paper']
    own, paper = (methods[name]['std_arcsec'] for name in ('template', 'paper'))
    curves, table_2 = report['curves'], report['table_2']
    headline = (f'σ {arcsec(own)} by the template, {arcsec(paper)} by the phase fit of the paper, '
                'on the same images')
    reading, two = np.arange(1.0, 24.0), ('paper', 'template')
    marks = {name: (style, f'{name} ({_MARKS[style]})') for name, style in STYLES.items()}
    body = [
        page.heading('23-face test of the absolute encoder'),
        page.paragraph(
            f'{conditions["readings"]} readings in {conditions["turns"]} turns · '
            f'{conditions["bar_pitch_px"]:g} px a bar · noise '
            f'{conditions["noise_grey_levels"]:g} grey levels unless said · a simulated bench',
            'meta'),
        page.verdict_section(headline, [
            page.cards([(own, 'template, σ'), (paper, 'method of the paper, σ'),
                        (PRINTED_STD['paper'], 'printed in the paper, σ (its own camera)')]),
            page.legend(tuple(marks[name] for name in two)),
            _curves('One turn', reading, curves['first_turn'], two)]),
        errors_section(_largest(methods)),
        page.section('Methods', _methods(report)),
        page.folded_section('Notes', page.sentence_list(notes(report))),
        page.folded_section('Standard deviations', page.bar_chart([(name.replace('_', ' '), [
            (row['std_arcsec'], 'after' if name == 'template' else 'before', 'here'),
            (PRINTED_STD.get(name), 'floor', 'printed')]) for name, row in methods.items()])),
        page.folded_section('Errors at the 23 angles', [
            page.legend(tuple(marks.values())), page.figure_pair([
            _curves(f'Noise of {loud["noise_grey_levels"]:g} grey levels (fig. 11)', reading,
                    curves['noise_of_the_paper']),
            _curves('Bars displaced at readings 5, 10 and 15 (fig. 12)', reading,
                    curves['damaged']),
            _curves('Through one bar, without noise', np.array(curves['one_bar_position']),
                    curves['one_bar'], label='place in the bar ″', marks=False)])]),
        page.folded_section('One turn, reading by reading', page.table(
            ('reading', 'printed in table 2 ″', 'paper ″', 'template ″'),
            [(i + 1, page.number(table_2['errors_arcsec'][i]),
              *(page.number(curves['first_turn'][name][i]) for name in ('paper', 'template')))
             for i in range(23)], 'numbers sort')),
        page.folded_section('What the other methods would need', _needed(report['needed']),
                            'To be as bad as the paper found them, by one disturbance alone.'),
        provenance_section([('seed', str(conditions['seed'])), ('code', conditions['code']),
                            ('bench', f'table off by {conditions["table_error_arcsec"]:.2f}″ at '
                             f'most, blur {conditions["blur_px"]:g} px')], files)]
    return whole('23-face test of the absolute encoder', body, 'Test of an absolute encoder')


def _curves(title, x, curves, names=tuple(STYLES), label='reading', marks=True):
    """Curves of the methods' errors, without gross errors and rejected readings."""
    values = {name: np.array([np.nan if v is None or abs(v) > _GROSS else v
                              for v in curves[name]]) for name in names}
    limit = limit_of(*(v[np.isfinite(v)] for v in values.values()))
    margin = 0.02 * float(np.ptp(x))
    panel = Panel((52, 26, 378, 200), (float(x.min()) - margin, float(x.max()) + margin),
                  (-limit, limit))
    panel.axes(label, 'error ″', title)
    deviations = []
    for name, y in values.items():
        good = np.isfinite(y)
        panel.line(x[good], np.clip(y[good], -limit, limit), f'series {STYLES[name]}')
        if marks:
            panel.points(x[good], y[good], STYLES[name])
        if good.sum() > 1:
            deviations.append(f'{name} {np.std(y[good], ddof=1):.2f}')
    return page.figure(svg(446, 274, panel.parts, f'{title}. Standard deviation, arcsec: '
                           + ', '.join(deviations)), f'{title}.')


def _largest(methods):
    """Each method of the paper as an error, and what to do."""
    own = methods['template']['std_arcsec']
    return sorted((ErrorLine(
        _NAMES[name], None,
        float(np.sqrt(max(methods[name]['std_arcsec']**2 - own**2, 0.0))), [cause],
        'read by the template (method: template)')
        for name, cause in _CAUSES.items()), key=lambda one: -one.removes_arcsec)


def _methods(report):
    loud = report['noise_of_the_paper']['methods']
    rows = [(name.replace('_', ' '), page.number(row['std_arcsec']),
             page.number(PRINTED_STD.get(name)), page.number(row['max_arcsec']), row['rejected'],
             row['gross'],
             page.number(report['damaged']['methods'][name]['rms_arcsec']),
             page.number(loud[name]['std_arcsec'])) for name, row in report['methods'].items()]
    return page.table(('method', 'σ ″', 'printed ″', 'largest of a turn, mean ″', 'rejected',
                       'one bar off (not in σ)', 'damaged bars, RMS ″',
                       'σ with the noise of the paper ″'), rows, 'numbers sort')


def _needed(rows):
    return page.table(
        ('disturbance', 'method', 'level needed', 'unit', 'sine there ″', 'R-square there'),
        [(row['disturbance'].replace('_', ' '), row['rival'], page.number(row['level'], 1),
          row['unit'], page.number(row['paper_arcsec'], 1), page.number(row['r_square']))
         for row in rows], 'numbers')
