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

import re

import numpy as np
import pytest

from calibration.analysis.run_fit import fit_run
from calibration.calibration_state import CalibrationState
from calibration.report.documents import fit_document
from calibration.report.fit_tables import fit_tables
from calibration.report.night_tables import night_parts, night_tables
from calibration.report.row_wording import left_out_lines
from calibration.report.terminal_layout import layered
from calibration.report.terminal_tables import terms_table
from msg_tools.units import ARCSEC, DEG
from pointing_model.runs.run import PointingRun
from pointing_model.sky.star_catalogue import POLARIS_HIP


def run(n=40, number=1, star=None, zero=0.0, seed=0):
    rng = np.random.default_rng(seed)
    az, el = rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(0.35, 0.99, n))
    if star is not None:
        az, el = 0.4 * DEG + 1e-4 * np.arange(n), 34.9 * DEG + 1e-5 * np.arange(n)
    x, y = (rng.normal(size=(2, n)) + [[60.0], [-30.0]]) * ARCSEC
    return PointingRun({
        'az': az, 'el': el, 'az_enc': az + x / np.cos(el) + zero, 'el_enc': el + y,
        'star': np.arange(n) + 1.0 if star is None else np.full(n, float(star)),
        'run': np.full(n, float(number))})


@pytest.fixture(scope='module')
def night():
    session = CalibrationState()
    drift = 20 * ARCSEC
    for stamp, block in enumerate((
            run(seed=1), run(6, star=POLARIS_HIP, seed=2), run(6, 2, POLARIS_HIP, drift, seed=3),
            run(40, 2, zero=drift, seed=4))):
        session.add(block, stamp + 1)
    session.calibrate_zero()
    return session.observations(), *session.fit()


def text_of(things):
    from rich.console import Console
    console = Console(width=120, highlight=False)
    with console.capture() as capture:
        for thing in things:
            console.print(thing)
    return capture.get()


def test_every_number_of_the_report_is_in_a_table(night):
    report = night[2]
    text = text_of([*night_tables(report), terms_table(report['terms'])])
    for step in report['steps']:
        row = next(line for line in text.splitlines() if line.strip().startswith(step['step']))
        assert row.split()[-6:] == [
            f'{step[half][key]:.2f}' for half in ('used', 'held_out') for key in
            ('x', 'y', 'radial')]
    for zero in report['zeros']:
        assert f'{zero["az_arcsec"]:+.2f} ± {zero["sigma_az_arcsec"]:.2f}' in text
    for term in report['terms']:
        assert f' {term["name"]} {term["value_arcsec"]:+.2f} {term["sigma_arcsec"]:.2f} ' in (
            ' '.join([*text.split(), '']))
    for check in report['external_check']:
        assert check['check'] in text
    assert 'change 1 to 2' in text and 'simulated' not in text
    assert text.count('arcsec') >= 4


def test_the_simulated_change_stands_beside_the_measured_one(night):
    report = {**night[2], 'changes': [{**night[2]['changes'][0], 'simulated': {
        'az_arcsec': 20.0, 'el_arcsec': -0.25}}]}
    line = next(line for line in text_of(night_tables(report)).splitlines() if 'simulated' in line)
    assert line.split() == ['simulated', '+20.00', '-0.25']


def test_an_alarm_is_always_printed(night):
    alarms = [f'the absolute encoder moved by {k} arcsec' for k in range(30)]
    first, more, rest = night_parts({**night[2], 'witnesses': {'alarms': alarms, 'notes': []}})
    shown = layered(first, more, files=8, rest=rest)
    assert [part for part in shown if str(part).startswith('alarm: ')] == [
        f'alarm: {line}' for line in alarms]


def test_nothing_is_cut_on_a_pipe(night):
    text = text_of(night_tables(night[2]))
    assert '…' not in text and max(map(len, text.splitlines())) <= 120


def test_a_night_without_zeros_has_no_table_of_them():
    session = CalibrationState()
    session.add(run(), 1)
    titles = [str(table.title) for table in night_tables(session.fit()[1])]
    assert not any('Zero' in title or 'External' in title for title in titles)


def test_terms_table_has_signs():
    text = text_of([terms_table([{'name': 'IA', 'value_arcsec': -1.234, 'sigma_arcsec': 0.5},
                                 {'name': 'CA', 'value_arcsec': 2.0, 'sigma_arcsec': 0.25}])])
    rows = [line.split() for line in text.splitlines()]
    assert ['IA', '-1.23', '0.50'] in rows and ['CA', '+2.00', '0.25'] in rows


def test_fit_tables_say_what_was_left_out_and_what_is_uncertain():
    rows = run(60)
    rows.meta.update(excluded=[{'row': 3, 'reason': 'a cloud'}], notes=['in two files'])
    # all in one direction: the terms cannot be told apart well
    narrow = rows.select(np.arange(60))
    narrow.columns['az'] = 1.0 + 0.05 * narrow['az']
    narrow.columns['az_enc'] = narrow['az'] + (rows['az_enc'] - rows['az'])
    found = fit_run(narrow)
    text = text_of(fit_tables(found, fit_document(found)))
    assert 'row 3 left out: a cloud' in text
    assert 'note: in two files' in text
    assert 'correlations above 0.9: ' in text
    assert '60 of 61 rows' in text and re.search('^ raw  ', text, re.M)
    assert '7 terms, fit residuals' in text and '7 terms, cross-validated (2 halves)' in text


def test_rows_left_out_are_a_line_for_each_reason():
    lines = left_out_lines([{'row': 3 * k, 'reason': 'a cloud'} for k in range(1, 42)]
                           + [{'row': 4, 'reason': 'a bird'}])
    assert lines == ['rows 3, 6, 9, 12, 15, 18, 21, 24, 27, 30, ... (41 rows) left out: a cloud',
                     'row 4 left out: a bird']
    many = left_out_lines([{'row': k, 'reason': f'the same as row {k - 1}'} for k in range(40)])
    assert len(many) < 15 and many[-1].startswith('28 rows more left out, for 28 other reasons')
