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

"""Paper 000's table 1 and figures 1 and 2, our numbers next to the paper's."""

from itertools import zip_longest

import numpy as np

from calibration.analysis.external_check import gps_statistics
from calibration.report.terminal_tables import new_table
from pointing_model.rms import rms

COLUMNS = ('night', 'before_az_arcsec', 'before_el_arcsec', 'after_az_arcsec', 'after_el_arcsec')

#: Paper 000, table 1, interpreted as mean errors of the stars of a night, azimuth as coordinate
#: angle; the paper states neither (docs/papers.md).
PAPER_TABLE_1 = tuple(dict(zip(COLUMNS, row)) for row in (
    (1, 3.5, -14.1, -2.6, -0.7),
    (2, -12.0, -7.3, -0.2, 0.1),
    (3, -12.0, -7.0, -0.2, 0.1),
    (4, 12.9, 4.6, -0.2, 0.7),
    (5, 7.6, 7.7, 0.1, -0.5),
    (6, 9.0, 22.0, -1.9, -0.3),
    (7, 0.8, 6.7, 0.5, 0.6),
    (8, 5.8, 3.8, -0.3, -0.3),
    (9, -7.5, -1.5, -0.2, -0.5),
    (10, 0.3, 8.5, -2.2, 0.7),
    (11, 3.9, 1.5, -2.2, -0.8),
))
#: pointing specification of the paper's telescope (section 1.1)
SPECIFICATION_ARCSEC = 8.0


def compare_with_paper(nights, count):
    """All results of the experiment.

    Parameters
    ----------
    nights : list of dict
        Rows of `calibration.night_series.NightSeries`.
    count : int
        Nights of table 1; an additional night is the case of the paper's section 1.1.

    Returns
    -------
    dict
        ``table1`` (a dict of `COLUMNS` per night), ``nights``, ``statistics`` (by column: mean,
        std, rms), ``paper`` (the same for the paper's table), ``budget`` (of the means after
        calibration, in sigmas), ``gps``, ``case_1_1`` and ``alarms``; JSON-ready.

    Raises
    ------
    ValueError
        A night is missing.
    """
    by_number = {row['night']: row for row in nights}
    missing = [n for n in range(1, count + 1) if n not in by_number]
    if missing:
        raise ValueError(f'no calibrated night {", ".join(map(str, missing))}')
    chosen = [by_number[n] for n in range(1, count + 1)]
    table = [_row(night) for night in chosen]
    after = [night['physical']['after'] for night in chosen]
    tracks = next((night['satellite'] for night in chosen if night.get('satellite')), None)
    return {
        'table1': table,
        'nights': nights,
        'statistics': statistics(table),
        'paper': {'table1': list(PAPER_TABLE_1), 'statistics': statistics(PAPER_TABLE_1)},
        'budget': {f'{axis}_chi': [night[f'{axis}_mean_arcsec'] / night[f'{axis}_sigma_arcsec']
                                   for night in after] for axis in ('az', 'el')},
        'satellite': tracks,
        'gps': None if tracks is None else gps_statistics(tracks),
        'case_1_1': _case(by_number.get(count + 1)),
        'alarms': [f'night {night["night"]}: {alarm}' for night in chosen
                   for alarm in night['alarms']],
    }


def _row(night, kind='physical'):
    means = night[kind]
    return {'night': night['night'], **{
        f'{part}_{axis}_arcsec': means[part][f'{axis}_mean_arcsec']
        for part in ('before', 'after') for axis in ('az', 'el')}}


def _case(night):
    if night is None:
        return None
    zero, before, after = (night['physical'][key] for key in ('zero', 'before', 'after'))
    # on the sky, at the elevation that the zero's contamination by CA implies: 1 / cos E
    cos_el = 1.0 / zero['contamination']['az']['CA']
    return {
        'polaris_off_arcsec': float(np.hypot(
            night['physical']['change_az_arcsec'] * cos_el,
            night['physical']['change_el_arcsec'])),
        'specification_arcsec': SPECIFICATION_ARCSEC,
        **{f'{part}_{name}_arcsec': values[f'radial_{name}_arcsec']
           for part, values in (('before', before), ('after', after)) for name in ('rms', 'max')},
    }


def statistics(table):
    """Mean, standard deviation and RMS of each column of table 1, arcsec.

    Parameters
    ----------
    table : sequence of dict
        Rows with `COLUMNS`.

    Returns
    -------
    dict of str to dict of str to float
    """
    out = {}
    for name in COLUMNS[1:]:
        values = np.array([row[name] for row in table])
        out[name] = {'mean': float(values.mean()), 'std': float(values.std(ddof=1)),
                     'rms': rms(values),
                     'max': float(np.abs(values).max())}
    return out


# --- for people -----------------------------------------------------------------------------------


def short_table(report):
    """Means of the nights before and after calibration, ours next to the paper's.

    Parameters
    ----------
    report : dict
        Result of `compare_with_paper`.

    Returns
    -------
    rich.table.Table
    """
    out = new_table(f'{len(report["table1"])} nights, arcsec', '', 'before: az', 'paper', 'el',
                    'paper', 'after: az', 'paper', 'el', 'paper')
    _add_statistics(out, report)
    return out


def short_lines(report):
    """The satellite and the power-on of the paper's section 1.1, a list of str."""
    lines = []
    if report['gps']:
        lines.append('GPS satellite, mean on the sky, arcsec: ' + ', '.join(
            f'{report["gps"][when]["az_sky_mean_arcsec"]:+.2f} and '
            f'{report["gps"][when]["el_mean_arcsec"]:+.2f} {when} calibration'
            for when in ('before', 'after')))
    rows = [night.get('physical', {}) for night in report['nights']]
    pairs = [[row[when]['radial_rms_arcsec'] for row in rows if row.get(when)]
             for when in ('before', 'after')]
    if all(pairs):
        lines.append('radial RMS of a night, median: ' + ', '.join(
            f'{np.median(values):.2f}″ {when}' for values, when in zip(
                pairs, ('with the old zero', 'with the zero of Polaris'))))
    return lines


def experiment_tables(report):
    """Tables of `compare_with_paper`.

    Parameters
    ----------
    report : dict

    Returns
    -------
    list of rich.table.Table
    """
    tables = [_table_1(report), _kinds(report)]
    if report['gps']:
        tables.append(_satellite_table(report['gps']))
    if report['case_1_1']:
        tables.append(_case_table(report['case_1_1']))
    return tables


def _table_1(report):
    out = new_table(
        'Paper 000, table 1: mean error of the stars of a night, arcsec (azimuth: coordinate)',
        'night', 'before: az', 'paper', 'el', 'paper', 'after: az', 'paper', 'el', 'paper')
    for ours, theirs in zip_longest(report['table1'], report['paper']['table1']):
        if ours is None:
            break  # fewer nights than the paper's
        out.add_row(str(ours['night']), *(
            '' if row is None else f'{row[name]:+.1f}' if row is theirs else f'{row[name]:+.2f}'
            for name in COLUMNS[1:] for row in (ours, theirs)))
    out.add_section()
    _add_statistics(out, report)
    return out


def _add_statistics(out, report):
    for key in ('mean', 'std', 'rms'):
        out.add_row(key.upper() if key == 'rms' else key, *(
            f'{which[name][key]:+.2f}' if key == 'mean' else f'{which[name][key]:.2f}'
            for name in COLUMNS[1:]
            for which in (report['statistics'], report['paper']['statistics'])))


def _kinds(report):
    """Both kinds of models, on the sky: azimuth times cos(elevation)."""
    out = new_table(
        'The same stars on the sky, arcsec: mean (x) and radial RMS, by model of two nights before',
        'night', '7 terms, before: x', 'el', 'RMS', 'after: x', 'el', 'RMS',
        '13 harmonics, after: x', 'el', 'RMS')
    for night in report['nights']:
        cells = []
        for kind, part in (('physical', 'before'), ('physical', 'after'), ('harmonics', 'after')):
            values = night.get(kind, {}).get(part)
            cells += ['-'] * 3 if values is None else [
                f'{values["x_mean_arcsec"]:+.2f}', f'{values["el_mean_arcsec"]:+.2f}',
                f'{values["radial_rms_arcsec"]:.2f}']
        out.add_row(str(night['night']), *cells)
    return out


def _satellite_table(gps):
    out = new_table('GPS satellite 26690, tracked - computed, mean ± std, arcsec', 'zero',
                    'azimuth', 'paper', 'elevation', 'paper', 'az × cos E', 'exposures')

    def cell(numbers, axis):
        return f'{numbers[f"{axis}_mean_arcsec"]:+.2f} ± {numbers[f"{axis}_std_arcsec"]:.2f}'

    for key in ('before', 'after'):
        ours, paper = gps[key], gps['paper'][key]
        out.add_row(f'{key} calibration', cell(ours, 'az'), cell(paper, 'az'), cell(ours, 'el'),
                    cell(paper, 'el'), cell(ours, 'az_sky'), str(ours['n']))
    return out


def _case_table(case):
    out = new_table("The paper's section 1.1: after a power-on, arcsec on the sky",
                    '', 'before', 'after', 'paper, before', 'specification')
    out.add_row('Polaris off by', f'{case["polaris_off_arcsec"]:.1f}', '', '18', '')
    out.add_row('pointing error, RMS', f'{case["before_rms_arcsec"]:.1f}',
                f'{case["after_rms_arcsec"]:.1f}', '', f'{case["specification_arcsec"]:g}')
    out.add_row('pointing error, largest', f'{case["before_max_arcsec"]:.1f}',
                f'{case["after_max_arcsec"]:.1f}', '20', f'{case["specification_arcsec"]:g}')
    return out
