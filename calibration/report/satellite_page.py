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

"""Tracks of satellites: terminal table of the arcs, and the page with a plot of each."""

from datetime import datetime, timezone

import numpy as np

from msg_tools.units import ARCSEC

from . import page_parts as page
from .drawing import Panel, limit_of, svg
from .error_ranking import errors_section, term_lines
from .page_html import body_of, whole
from .provenance import provenance_section
from .terminal_tables import new_table

#: largest number of arcs plotted on the page
_MOST = 24
_BOX, _SIZE = (52, 26, 378, 130), (446, 204)


def tracks_table(document):
    """Arcs as a table for the terminal."""
    out = new_table('Encoder − orbit by arc, mean ± scatter on the sky, arcsec', 'object',
                    'UTC', 'min', 'elevation', 'raw, first axis', 'raw, second axis',
                    'left along', 'left across')
    for arc in document['arcs']:
        out.add_row(*_cells(arc))
    return out


def _cells(arc):
    begin = datetime.fromtimestamp(arc['begin'], timezone.utc)
    star = 'along_std_arcsec' not in arc['after']

    def both(when, axis):
        of = arc[when]
        return (f'{of[f"{axis}_mean_arcsec"]:+.1f} ± {of[f"{axis}_std_arcsec"]:.1f}'
                if f'{axis}_std_arcsec' in of else '–')
    return (arc['object'], f'{begin:%Y-%m-%d %H:%M}', f'{(arc["end"] - arc["begin"]) / 60.0:.0f}',
            f'{arc["el_min_deg"]:.0f}–{arc["el_max_deg"]:.0f}°', both('before', 'x'),
            both('before', 'y'), both('after', 'x' if star else 'along'),
            both('after', 'y' if star else 'across'))


def headline_of(document):
    """The headline of the page: accuracy of the model, or that there is none."""
    names = ', '.join(one['name'] for one in document['satellites'])
    if not document['determined']:
        return f'Tracks of {names} do not determine the terms'
    return (f'Model from {names}: {document["sky_sigma_arcsec"]:.2f}″ over the sky, '
            f'{document["after"]["radial_arcsec"]:.2f}″ left')


def render_tracks(fit, document, diagnosis, files):
    """The page as text.

    Parameters
    ----------
    fit : satellites.track_fit.TrackFit
    document : dict
        Its `track_document`, with findings replaced by sentences.
    diagnosis : view of a diagnosis, or None
        Diagnosis of the residuals.
    files : iterable of Path
        Input files.

    Returns
    -------
    str
    """
    headline, clock = headline_of(document), document.get('clock')
    mount = fit.tracks.run.mount.names
    first, *others = _curves(fit, mount) or [None]
    marks = page.legend((('before', 'raw'), ('fit', 'without the zeros of the axes'),
                         ('after', 'without terms, clock and orbits')))
    body = [
        page.heading('Tracks of satellites'),
        page.paragraph(f'{document["rows"]} rows, {len(document["arcs"])} arcs', 'meta'),
        page.verdict_section(headline, [
            page.cards([(f'{document["before"]["radial_arcsec"]:.2f}″', 'raw, radial RMS'),
                        (f'{document["after"]["radial_arcsec"]:.2f}″',
                         'left by terms, clock and orbits'),
                        (None if clock is None else f'{1e3 * clock["late_s"]:+.1f} ± '
                         f'{1e3 * clock["sigma_s"]:.1f} ms', 'clock (positive: stamps are late)')]),
            first and [marks, first], page.sentence_list(document['notes'])]),
        errors_section(term_lines(document['terms'], fit.tracks.run)),
        page.section('Terms', page.table(('term', 'value ″', '± ″'), [
            (term['name'], page.number(term['value_arcsec'], 2, True),
             page.number(term['sigma_arcsec'])) for term in document['terms']], 'numbers'),
            'Encoder − orbit; σ with correlated noise.'),
        page.section('Satellites', page.table(
            ('satellite', 'rows', 'arcs', 'orbit ± m', 'ahead ms', '± ms', 'separated'),
            [(one['name'], f'{one["rows"]}', f'{one["arcs"]}', page.number(one['orbit_sigma_m']),
              page.number(1e3 * one['ahead_s'], 2, True), page.number(1e3 * one['ahead_sigma_s']),
              None if one['ahead_sigma_s'] < 1e-4 else 'yes' if one['separated'] else 'no')
             for one in document['satellites']], 'numbers'),
            'Ahead: of its place by the orbit, along the track. Separated: from the zeros, '
            'the clock and the other satellites; – where the orbit is precise.'),
        page.folded_section('Errors along each arc', others and [marks, *others],
            f'Encoder − orbit against the time: {mount.axes[0]} on the sky and '
            f'{mount.axes[1]}, raw and without the zeros. Then along and across the track, '
            'all removed.'),
        page.folded_section('Arcs', page.table(
            ('object', 'UTC', 'min', 'elevation', f'raw {mount.axes[0]} ″',
             f'raw {mount.axes[1]} ″', 'left along ″', 'left across ″'),
            [_cells(arc) for arc in document['arcs']])),
        page.folded_section('Diagnosis', body_of(_diagnosis_page(diagnosis, files))),
        provenance_section([], files)]
    return whole(f'Tracks of satellites: {headline}', body, 'Tracks of satellites by a mount')


def _diagnosis_page(view, files):
    from .diagnosis_page import render
    return '' if view is None else render(view, files)


def _curves(fit, mount):
    """Plots of the satellite arcs, at most `_MOST` of them."""
    tracks, out = fit.tracks, []
    time = np.asarray(tracks.run['time'], float)
    zeros = {name: fit.model.terms.get(name, 0.0) for name in mount.index}
    second = tracks.run['el']
    without = fit.before - np.stack((zeros[mount.index[0]] * np.cos(second),
                                     np.full(len(time), zeros[mount.index[1]])))
    along = np.stack(tracks.along(*fit.after))
    arcs = [arc for arc in np.unique(tracks.arc)
            if not tracks.is_star[np.flatnonzero(tracks.arc == arc)[0]]]
    for arc in arcs[:_MOST]:
        rows = np.flatnonzero(tracks.arc == arc)
        minutes = (time[rows] - time[rows[0]]) / 60.0
        name = tracks.objects[tracks.object[rows[0]]]
        begin = datetime.fromtimestamp(time[rows[0]], timezone.utc)
        title = f'{name}, {begin:%Y-%m-%d %H:%M}'
        raw = [_panel(minutes, [(fit.before[i, rows], 'before'), (without[i, rows], 'fit')],
                      f'{title}: {axis}') for i, axis in enumerate(mount.axes)]
        left = [_panel(minutes, [(along[i, rows], 'after')], f'{title}: {word}')
                for i, word in enumerate(('along the track', 'across'))]
        out += [page.figure_pair(raw), page.figure_pair(left)]
    if len(arcs) > _MOST:
        out.append(page.sentence_list([f'{len(arcs) - _MOST} more arcs are in the table alone']))
    return out


def _panel(minutes, series, title):
    limit = limit_of(*(values / ARCSEC for values, _ in series))
    panel = Panel(_BOX, (minutes.min() - 0.2, minutes.max() + 0.2), (-limit, limit))
    panel.axes('minutes', 'arcsec', title)
    for values, style in series:
        panel.points(minutes, values / ARCSEC, style)
    return page.figure(svg(*_SIZE, panel.parts, title))
