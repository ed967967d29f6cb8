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

"""Pages of a night and of a fit: what they say, how a browser shows them, that none does harm.

How fast one opens `benchmarks/pages.py` says.
"""

import itertools
import json
import re
import xml.etree.ElementTree as ElementTree
from types import SimpleNamespace

import numpy as np
import pytest
from a_night import a_night
from chromium import Browser, program
from page_audit import audit
from places import LOG, ROOT

from calibration.analysis.diagnosis.diagnosis import diagnose
from calibration.analysis.run_fit import fit_run
from calibration.report.diagnosis_page import render
from calibration.report.diagnosis_view import view_of
from calibration.report.documents import fit_document
from calibration.report.fit_page import render_fit
from calibration.report.log_health import log_health
from calibration.report.night_page import (
    night_page,
    page_of_log,
    render_night,
    residuals_of,
)
from calibration.report.number_wording import number, value_and_error
from calibration.report.page_html import CSS, drawn
from calibration.report.provenance import sum_of
from calibration.report.residual_figures import controls, residual_sections
from calibration.report.residuals import Residuals
from calibration.report.zero_figures import zeros_of
from msg_tools import convert, topics
from msg_tools.bag import BagReader, BagWriter
from msg_tools.units import ARCSEC
from pointing_model.model import PointingModel
from pointing_model.rms import rms
from pointing_model.runs.run import PointingRun

EVIL = '"><script>document.title="taken"</script><img src=x onerror=alert(2)>\x07\u202e'
WIDTHS = (400, 1000, 1600)


@pytest.fixture(scope='module')
def night(tmp_path_factory):
    """A night's folder as the command leaves it, and what it was made from."""
    folder = tmp_path_factory.mktemp('night')
    run, model, report = a_night()
    report['notes'].append(EVIL)
    (folder / 'report.json').write_text(json.dumps(report))
    (folder / 'bag').mkdir()
    path = folder / 'page.html'
    path.write_text(night_page(run, model, report, folder / 'bag'), encoding='utf-8')
    return SimpleNamespace(folder=folder, run=run, model=model, report=report, path=path,
                           text=path.read_text(encoding='utf-8'))


def measured(n, runs=1, seed=1):
    """A run with hysteresis and one wild row; names that would do harm."""
    rng = np.random.default_rng(seed)
    az, el = rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(0.3, 0.98, n))
    side = rng.choice([-1.0, 1.0], n)
    x, y = rng.normal(size=(2, n)) * ARCSEC
    x[n // 2] += 60.0 * ARCSEC
    time = 1.7e9 + np.sort(rng.uniform(0, 3e4 * runs, n))
    names = [f'{i} {EVIL}' if i % 10 == 0 else str(i) for i in range(n)]
    return PointingRun({
        'time': time, 'az': az, 'el': el, 'az_enc': az + (30 + 4 * side) * ARCSEC + x / np.cos(el),
        'el_enc': el + y, 'star': np.array(names),
        'approach_az': side, 'run': np.floor((time - time[0]) / 3e4)},
        {'source': f'/some/where/{EVIL}.csv', 'notes': [EVIL]})


@pytest.fixture(scope='module')
def fitted(tmp_path_factory):
    """The page of a fit to the 1044 rows of a large run."""
    run = measured(1044, 5)
    found = fit_run(run)
    document = fit_document(found)
    path = tmp_path_factory.mktemp('fit') / 'page.html'
    path.write_text(render_fit(found, document), encoding='utf-8')
    return SimpleNamespace(path=path, document=document, text=path.read_text(encoding='utf-8'))


# ------------------------------------------------------------------------------- what is on them

def test_the_page_of_a_night_has_every_part(night):
    headings = re.findall('<h2>([^<]*)</h2>', night.text)
    assert headings[1:] == [
        'Largest errors', 'Terms of the model', 'RMS', 'Target', 'Residuals in time',
        'Residuals by axis', 'Histograms', 'Stars', 'Zero by power-on',
        'Encoders and instruments', 'Models compared', 'Diagnosis', 'Notes', 'Provenance']
    last = next(step for step in night.report['steps'] if step['step'] == '7 physical terms')
    assert headings[0].startswith(
        f'{last["held_out"]["radial"]:.2f}″ RMS on held-out stars with the model; ')
    assert sum_of(night.folder / 'report.json') in night.text


@pytest.mark.parametrize('name', ['night', 'fitted'])
def test_a_page_is_well_formed_stands_alone_and_is_small(request, name):
    page = request.getfixturevalue(name)
    root = ElementTree.fromstring(page.text.split('\n', 1)[1])
    assert all(drawing.get('aria-label') for drawing in root.iter('svg'))
    assert all(head.get('scope') for head in root.iter('th'))
    for word in ('://', 'url(', '@import', 'srcset', '<link', '<iframe', 'src='):
        assert word not in page.text.replace('&lt;img src=', ''), word
    assert len(page.text.encode()) < (400_000 if name == 'night' else 1_000_000)
    assert page.text.count('<script') == 1 and '\x07' not in page.text


def test_what_became_of_each_row_is_told(night):
    data = residuals_of(night.run, night.model, night.report, split_seed=1)
    assert len(data) == 40 and data.used.sum() == 39
    outlier, = (word for word, used in zip(data.words, data.used) if not used)
    assert re.match('rejected: an outlier, (39|40|41).[0-9]″ off', outlier)
    assert outlier.partition(';')[0] in night.text
    # the stars held out are those by which the report judges, and before is its second step
    step = next(s for s in night.report['steps'] if s['step'].startswith('zero set'))
    held = np.array(['held out in the check' in word for word in data.words])
    assert held.sum() == step['held_out']['n']
    assert rms(*data.before[:, held]) == pytest.approx(step['held_out']['radial'], rel=1e-9)
    late = residuals_of(night.run, night.model, {**night.report, 'last_stamp_ns': int(
        1e9 * (night.run['time'][-1] - 10.0))}, split_seed=1)
    assert list(late.words).count('came after the fit') == 1


def test_zeros_by_the_sky_and_by_the_encoders(night):
    first, second = zeros_of(night.report, night.run)
    for axis, moved in (('az', 20.0), ('el', -12.0)):
        assert second[axis]['measured'] - first[axis]['measured'] == pytest.approx(moved, abs=2.0)
        assert second[axis]['in_force'] - first[axis]['in_force'] == pytest.approx(moved, abs=2.0)
    # the absolute encoder of this night is carried along in azimuth
    assert second['az']['apart'] - first['az']['apart'] == pytest.approx(0.0, abs=0.5)
    assert first['air'] == pytest.approx(10.0, abs=0.2) and first['encoder'] is None


def test_a_log_tells_how_its_instruments_did():
    health = log_health(LOG)
    assert all(row['count'] > 0 and row['rate_hz'] != 0.0 for row in health['streams'])
    assert {'streams', 'marks', 'sigmas_arcsec', 'nodes', 'whole'} <= set(health)


def test_older_logs_have_the_errors_of_readings_as_joint_states(tmp_path):
    from rclpy.serialization import serialize_message
    axes, sigmas, found = convert.JOINTS['equatorial'], ((1e-7, 2e-7), (3e-7, np.nan)), []
    older = topics.Topic('absolute/sigma', topics.ABSOLUTE.type, topics.ABSOLUTE.quality)
    for topic, messages in (
            (older, [convert.joint_state(1, pair, names=axes) for pair in sigmas]),
            (topics.ABSOLUTE_POSE, [convert.pose(1, (0.1, 0.2), np.diag(np.square(pair)))
                                    for pair in sigmas])):
        rows = [(topics.ABSOLUTE, convert.joint_state(1, (0.1, 0.2), names=axes)),
                *((topic, message) for message in messages)]
        path = tmp_path / topic.name.replace('/', '_')
        with BagWriter(path) as log:
            for one in (topics.ABSOLUTE, topic):
                log.add_topic('/mount/' + one.name, one.type)
            for time, (one, message) in enumerate(rows, 1):
                log.write('/mount/' + one.name, serialize_message(message), time, time)
        found.append(log_health(path)['sigmas_arcsec'])
    for axis, none in zip(axes, (0, 1)):
        assert found[0][axis] == pytest.approx(found[1][axis])
        assert found[0][axis]['none'] == none and found[0][axis]['count'] == 2


def test_a_night_that_is_over_has_its_page_from_its_log(tmp_path):
    log = ROOT / 'examples' / 'night' / 'bag'
    text = page_of_log(log)
    ElementTree.fromstring(text.split('\n', 1)[1])
    report = json.loads([message.data.data for message in BagReader(log).messages(
        '/mount/calibration/report', decode=True)][-1])
    for term in report['terms']:
        assert value_and_error(term['value_arcsec'], term['sigma_arcsec'])[0] in text
    assert 'No message of an instrument was lost.' in text and len(text) < 400_000
    assert text.count('<tr data-i=') == report['stars'] == 60
    with BagWriter(tmp_path / 'empty'):
        pass
    with pytest.raises(ValueError, match='it is no log of a night'):
        page_of_log(tmp_path / 'empty')


@pytest.mark.parametrize('n', [0, 1])
def test_runs_of_no_row_and_of_one(n):
    run = a_night(2, 2)[0].select(2 + np.arange(n)) if n else measured(3).select(np.arange(0))
    text = render_night(run, PointingModel({}), {'notes': []})
    ElementTree.fromstring(text.split('\n', 1)[1])
    assert 'Nothing was fitted' in text
    assert (re.search('Nothing was fitted; [0-9.]+″ RMS, raw', text) is not None) == (n == 1)
    assert ('There is no row' in text) == (n == 0)


def test_rows_that_are_not_known_are_drawn_nowhere():
    nothing = np.full((2, 3), np.nan)
    data = Residuals(['a', 'b', 'c'], np.zeros(3), np.ones(3), nothing, nothing, np.ones(3, bool),
                     time=np.array([1.0, np.nan, 2.0]), groups=np.array([1.0, 1.0, 2.0]))
    text = drawn([controls(data), residual_sections(data)])
    assert 'nan' not in text and text.count('<tr data-i') == 3 and not data.used.any()


def test_nothing_has_no_sign():
    assert number(-0.001) == '0.00' and number(-0.02) == '−0.02' and number(None) == '–'
    assert number(0.0, 1, True) == '0.0' and number(3.0, 1, True) == '+3.0'


# ------------------------------------------------------------------------------------ the colours

#: how the colour-blind see (Machado, Oliveira and Fernandes 2009, severity 1), on linear RGB
SEEN = {'all': np.eye(3),
        'no red': [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216],
                   [-0.003882, -0.048116, 1.051998]],
        'no green': [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
                     [-0.011820, 0.042940, 0.968881]],
        'no blue': [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602],
                    [0.004733, 0.691367, 0.303900]]}
XYZ = np.array([[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750],
                [0.0193339, 0.1191920, 0.9503041]])


def lab(colour, seen):
    """CIELAB of #rrggbb."""
    c = np.array([int(colour[i:i + 2], 16) for i in (1, 3, 5)]) / 255
    linear = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055)**2.4)
    f = XYZ @ np.clip(np.array(seen) @ linear, 0, 1) / [0.95047, 1.0, 1.08883]
    f = np.where(f > 216 / 24389, np.cbrt(f), (24389 / 27 * f + 16) / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def least_apart(colours):
    return min(np.linalg.norm(lab(a, seen) - lab(b, seen)) for seen in SEEN.values()
               for a, b in itertools.combinations(colours, 2))


def test_colours_differ_for_everybody_by_day_and_by_night():
    from telescope_mount.papers.encoder_page import _MARKS
    of = {name: re.findall(f'--{name}:(#[0-9a-f]{{6}})', CSS)
          for name in ('before', 'after', 'fit', 'third')}
    for scheme in (0, 1):
        assert least_apart([values[scheme] for values in of.values()]) > 30.0
    assert least_apart(['#ff7f0e', '#2ca02c', '#1f77b4', '#d62728']) < 8.0  # as they were
    assert set(_MARKS) == set(of) and len(set(_MARKS.values())) == 4


# ------------------------------------------------------------------------------------- a browser

@pytest.fixture(scope='module')
def browser(tmp_path_factory):
    if program() is None:
        pytest.skip('no Chromium here (Debian: apt install chromium)')
    browser = Browser(tmp_path_factory.mktemp('chromium'))
    yield browser
    browser.close()


@pytest.fixture(scope='module')
def diagnosed(tmp_path_factory):
    path = tmp_path_factory.mktemp('diagnosis') / 'page.html'
    found = diagnose(measured(60), flips=99, cross_validation=False)
    path.write_text(render(view_of(found)), encoding='utf-8')
    return SimpleNamespace(path=path)


def _fits(browser):
    """Whether nothing is wider than the window."""
    return browser.run('document.documentElement.scrollWidth <= innerWidth')


@pytest.mark.parametrize('name', ['night', 'fitted', 'diagnosed'])
def test_in_a_browser_it_fits_and_asks_for_nothing(request, browser, name):
    path = request.getfixturevalue(name).path
    browser.window(1000)
    browser.show(path)
    assert browser.asked == [path.resolve().as_uri()]
    each = itertools.product(WIDTHS, (False, True))
    for width, dark in ((1000, False), (400, True)) if name == 'fitted' else each:
        browser.window(width, dark)
        assert _fits(browser), (width, dark)
        ground, ink = (browser.run(f'getComputedStyle(document.body).{what}')
                       for what in ('backgroundColor', 'color'))
        light = [sum(map(int, re.findall(r'\d+', colour)[:3])) for colour in (ground, ink)]
        assert (light[0] < light[1]) == dark
    browser.window(700, kind='print')
    assert _fits(browser)
    assert browser.run('getComputedStyle(document.querySelector(".controls")).display') == 'none'
    assert browser.complaints == [] and browser.run('document.title') != 'taken'
    assert len(browser.asked) == 1
    browser.window(1600)
    assert _fits(browser)


@pytest.mark.parametrize('width, dark', [(390, True), (1280, False)])
@pytest.mark.parametrize('name', ['night', 'diagnosed'])
def test_in_a_browser_nothing_is_cut_or_faint(request, browser, name, width, dark):
    assert audit(browser, request.getfixturevalue(name).path, width, dark) == []


def test_what_is_cut_or_faint_is_found(browser, tmp_path):
    path = tmp_path / 'page.html'
    path.write_text('<html><body style="background:#fff"><main><p style="color:#999">faint</p>'
                    '<p style="width:2000px;text-align:right">cut</p></main>'
                    '<script>nothing()</script></body></html>')
    found = audit(browser, path, 390, False)
    assert [one.partition(':')[0].partition(' 2')[0] for one in found] == [
        'wider than the window', 'contrast', 'cut', 'ReferenceError']


def test_in_a_browser_its_numbers_are_those_of_the_json(browser, night):
    browser.window(1000)
    browser.show(night.path)
    cells = browser.run("""Array.from(document.querySelectorAll('section')).map(s => [
        s.querySelector('h2').textContent, Array.from(s.querySelectorAll('tbody tr')).map(
        r => Array.from(r.cells).map(c => c.textContent.replace('\\u2212', '-')))])""")
    tables = dict(cells)
    terms = {row[0]: row for row in tables['Terms of the model'] if len(row) == 4}
    for term in night.report['terms']:
        # to the second digit of its error
        assert float(terms[term['name']][1]) == pytest.approx(
            term['value_arcsec'], abs=0.051 * term['sigma_arcsec'])
        assert float(terms[term['name']][2]) == pytest.approx(term['sigma_arcsec'], rel=0.051)
    models = {row[0].removesuffix(' ← published'): row
              for row in tables['Models compared']}
    for step in night.report['steps']:
        shown = list(map(float, models[step['step']][1:]))
        assert shown == pytest.approx([step[half][key] for half in ('used', 'held_out') for key in (
            'x', 'y', 'radial')] + [step['held_out']['n']], abs=5.1e-3)
    zeros = {float(row[0]): row for row in tables['Zero by power-on']}
    for zero in night.report['zeros']:
        assert float(zeros[zero['run']][4]) == pytest.approx(zero['az_arcsec'], abs=5.1e-3)
    data = residuals_of(night.run, night.model, night.report)
    after = [float(row[-2]) for row in tables['Stars']]
    assert after == sorted(after, reverse=True)
    assert after == pytest.approx(sorted(np.hypot(*data.after), reverse=True), abs=5.1e-3)


def test_in_a_browser_what_is_touched_lights_up(browser, night):
    browser.window(1000)
    browser.show(night.path)
    run = browser.run
    lit = 'Array.from(document.querySelectorAll(".lit")).map(e => e.dataset.i)'
    # what is folded has no focus
    run('document.querySelectorAll("section.fold details").forEach(e => { e.open = true; })')
    # a row by the keyboard: in every plot and in words
    run('document.querySelector("table.stars tbody tr").focus()')
    worst = run('document.activeElement.dataset.i')
    assert set(run(lit)) == {worst} and len(run(lit)) >= 7
    assert 'rejected: an outlier' in run('document.getElementById("told").textContent')
    run("""document.activeElement.dispatchEvent(
        new KeyboardEvent("keydown", {key: "ArrowDown", bubbles: true}))""")
    second = run('document.activeElement.dataset.i')
    assert second != worst and set(run(lit)) == {second}
    # a mark by the pointer: in the table
    mark = run("""(() => { const svg = document.querySelectorAll("svg.link")[3];
        svg.scrollIntoView(); const p = svg.querySelector("[data-i]");
        const b = p.getBoundingClientRect();
        svg.dispatchEvent(new MouseEvent("click", {bubbles: true,
            clientX: b.x + b.width / 2, clientY: b.y + b.height / 2})); return p.dataset.i })()""")
    assert set(run(lit)) == {mark} and run('document.querySelectorAll("tr.lit").length') == 1
    # where its table was folded, its row is in sight once that opens
    run("""window.box = document.querySelector("table.stars").closest(".tall");
        box.style.maxHeight = "90px"; box.scrollTop = 0;
        box.closest("details").open = false""")
    run('box.closest("details").open = true')
    assert run("""(() => { const row = box.querySelector("tr.lit").getBoundingClientRect();
        const seen = box.getBoundingClientRect();
        return row.top >= seen.top && row.bottom <= seen.bottom })()""")
    run('document.dispatchEvent(new KeyboardEvent("keydown", {key: "Escape"}))')
    assert run(lit) == []
    # before or after alone, and one power-on
    run('document.querySelector("input[value=after]").click()')
    assert run('getComputedStyle(document.querySelector("figure.when-before")).display') == 'none'
    assert run('getComputedStyle(document.querySelector("figure.when-after")).display') != 'none'
    run("""(() => { const g = document.getElementById("group"); g.value = "2";
        g.dispatchEvent(new Event("change")) })()""")
    assert run('document.querySelectorAll("tr[data-i]:not(.off)").length') == 20
    assert run('document.getElementById("told").textContent').startswith('power-on 2: ')
    # a heading sorts, numbers as numbers
    run('document.querySelectorAll("table.stars th button")[4].click()')
    shown = run("""Array.from(document.querySelectorAll("table.stars tbody tr")).map(
        r => Number(r.cells[4].textContent))""")
    assert shown == sorted(shown, reverse=True)
    assert browser.complaints == []
