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

"""Rows excluded on a page: its refit in a real browser beside the command's; zoom and export."""

import xml.etree.ElementTree as ElementTree
from types import SimpleNamespace

import numpy as np
import pytest
from chromium import Browser, program
from noisy_run import make_run

from calibration.analysis.diagnosis.diagnosis import diagnose
from calibration.analysis.run_fit import fit_run
from calibration.report.diagnosis_page import render
from calibration.report.diagnosis_view import view_of
from calibration.report.documents import fit_document
from calibration.report.fit_page import render_fit
from calibration.report.page_html import body_of
from msg_tools.units import ARCSEC

LINEAR = ('IA', 'IE', 'TF')  # columns that stay the same whatever their coefficients


@pytest.fixture(scope='module')
def browser(tmp_path_factory):
    if program() is None:
        pytest.skip('no Chromium here (Debian: apt install chromium)')
    browser = Browser(tmp_path_factory.mktemp('chromium'))
    browser.window(1280)
    yield browser
    browser.close()


@pytest.fixture(scope='module')
def run():
    return make_run(np.random.default_rng(3), 80)


def page_of(browser, folder, run, **how):
    found = fit_run(run, **how)
    path = folder / 'page.html'
    path.write_text(render_fit(found, fit_document(found)), encoding='utf-8')
    browser.show(path)
    return found


def terms(browser):
    return {name: (value, sigma) for name, value, sigma in browser.run('refitPreview.terms()')}


def without(run, lines):
    """The run that `--exclude` leaves."""
    return run.select(~np.isin(run.lines, lines))


def apart(browser, again):
    """How far the page's terms and sigmas are from those of a fit, arcsec."""
    here = terms(browser)
    return np.array([[here[name][0] - value / ARCSEC, here[name][1] - sigma / ARCSEC]
                     for name, value, sigma in zip(again.names, again.coefficients, again.sigma)])


def click(browser, find):
    """A click with the mouse on an element, which is scrolled into sight."""
    x, y = browser.run(f"""(() => {{ const e = {find}; e.scrollIntoView({{block: 'center'}});
        const b = e.getBoundingClientRect();
        return [b.x + b.width / 2, b.y + b.height / 2] }})()""")
    for kind in ('mousePressed', 'mouseReleased'):
        browser.call('Input.dispatchMouseEvent', type=kind, x=x, y=y, button='left', clickCount=1)


def drawn(browser):
    """Coordinates of all marks that a refit moves."""
    return browser.run("""Array.from(document.querySelectorAll("g[data-arrows] g[data-i] path,"
        + "g[data-when] path[data-i]")).map(
        e => e.getAttribute("d").match(/-?[0-9.]+/g).map(Number))""")


def button(word):
    return (f'Array.from(document.querySelectorAll("button")).find('
            f'e => e.textContent === "{word}")')


def test_a_linear_refit_in_the_page_is_that_of_the_command(browser, tmp_path, run):
    found = page_of(browser, tmp_path, run, terms=LINEAR, robust=False)
    assert found.terms.linear.names == LINEAR
    first = drawn(browser)
    for i in (12, 40, 41):
        key = browser.run(f'document.getElementById("refit").dataset.refit.split('
                          f'\'"keys": "\')[1].split(" ")[{i}]')
        click(browser, f'document.querySelector("g[data-i=\'{key}\'] circle")')
        assert browser.run(f'document.querySelectorAll("tr.lit[data-i=\'{key}\']").length') == 1
        click(browser, button('Exclude'))
    assert drawn(browser) != first
    lines = run.lines[[12, 40, 41]].tolist()
    again = fit_run(without(run, lines), LINEAR, robust=False)
    assert np.abs(apart(browser, again.terms)).max() < 1e-6
    assert browser.run('refitPreview.rms()') == pytest.approx(
        again.terms.rms_arcsec().radial, abs=1e-6)
    command = browser.run('document.getElementById("command").textContent')
    assert command.endswith(f' --exclude {lines[0]},{lines[1]}-{lines[2]}')
    assert 'Preview: 3 rows excluded' in browser.run(
        'document.getElementById("preview").textContent')
    for _ in range(3):
        click(browser, button('Undo'))
    assert browser.run('document.getElementById("preview").hidden')
    # what the script draws of all rows is what stood there, but for rounding
    assert len(first) > 500
    for one, other in zip(first, drawn(browser), strict=True):
        assert one == pytest.approx(other, abs=0.11)
    before = {name: value / ARCSEC for name, value in zip(LINEAR, found.terms.coefficients)}
    assert {name: value for name, (value, _) in terms(browser).items()} == pytest.approx(
        before, abs=1e-12)
    assert browser.complaints == []


@pytest.mark.parametrize('robust, near', [(False, 1e-3), (True, 2e-3)])
def test_with_rotations_and_weights_it_is_near(browser, tmp_path, run, robust, near):
    page_of(browser, tmp_path, run, robust=robust)
    lines = run.lines[[5, 60]].tolist()
    browser.run(f'refitPreview.exclude({lines})')
    assert np.abs(apart(browser, fit_run(without(run, lines), robust=robust).terms)).max() < near


def test_rows_that_the_terms_need_are_kept(browser, tmp_path, run):
    page_of(browser, tmp_path, run, terms=LINEAR)
    browser.run(f'refitPreview.exclude({run.lines.tolist()})')
    assert 'These rows are needed' in browser.run('document.getElementById("acts").textContent')
    assert not browser.run('document.querySelector("#preview")')


def test_effects_and_terms_of_a_diagnosis_are_refitted(browser, tmp_path):
    run = make_run(np.random.default_rng(4), 80)
    side = np.where(np.arange(80) % 2, 1.0, -1.0)
    run.columns['approach_az'] = side
    run.columns['az_enc'] = run['az_enc'] + 8 * ARCSEC * side
    found = diagnose(run, flips=99, cross_validation=False)
    path = tmp_path / 'page.html'
    path.write_text(render(view_of(found)), encoding='utf-8')
    browser.show(path)
    part = body_of(path.read_text(encoding='utf-8'))
    assert 'id="refit"' not in part and part.count('<div') == part.count('</div>')
    first = terms(browser)
    name = next(name for name in first if name.startswith('azimuth hysteresis'))
    assert abs(abs(first[name][0]) - 8.0) < 1.0
    browser.run('refitPreview.exclude([7, 30])')
    again, = diagnose(without(run, [7, 30]), flips=99, cross_validation=False).effects
    assert abs(terms(browser)[name][0] - again.fitted.coefficients[0] / ARCSEC) < 0.1
    assert browser.run('document.getElementById("command").textContent').endswith(
        ' --exclude 7,30')
    assert browser.complaints == []


def test_plots_zoom_and_are_saved(browser, tmp_path, run):
    page_of(browser, tmp_path, run, terms=LINEAR)
    plot = 'document.querySelector("svg.link")'
    whole = browser.run(f'{plot}.getAttribute("viewBox")')
    click(browser, plot)
    x, y = browser.run(f'(() => {{ const b = {plot}.getBoundingClientRect(); '
                       'return [b.x + b.width / 3, b.y + b.height / 3] })()')
    browser.call('Input.dispatchMouseEvent', type='mouseWheel', x=x, y=y, deltaX=0, deltaY=-400)
    zoomed = SimpleNamespace(box=browser.run(f'{plot}.getAttribute("viewBox")'))
    width = [float(box.split()[2]) for box in (whole, zoomed.box)]
    assert width[1] == pytest.approx(width[0] / np.e, rel=0.01)
    for kind, at in (('mousePressed', x), ('mouseMoved', x + 40), ('mouseReleased', x + 40)):
        browser.call('Input.dispatchMouseEvent', type=kind, x=at, y=y, button='left', buttons=1)
    moved = browser.run(f'{plot}.getAttribute("viewBox")')
    assert float(moved.split()[0]) < float(zoomed.box.split()[0])
    click(browser, button('Reset'))
    assert list(map(float, browser.run(f'{plot}.getAttribute("viewBox")').split())) == \
        list(map(float, whole.split()))
    browser.run("""window.saved = []; HTMLAnchorElement.prototype.click = function () {
        saved.push([this.download, this.href]) }""")
    click(browser, button('SVG'))
    click(browser, button('PNG'))
    browser.wait('saved.length === 2')
    (name, drawing), (_, image) = browser.run('saved')
    assert name == 'map-of-the-sky-raw-' + name.split('-raw-')[1] and name.endswith('.svg')
    text = browser.run('decodeURIComponent(saved[0][1]).split(",").slice(1).join(",")')
    root = ElementTree.fromstring(text)
    assert root.tag == '{http://www.w3.org/2000/svg}svg' and 'stroke:rgb' in text
    assert image.startswith('data:image/png;base64,') and len(image) > 5000
    assert drawing.startswith('data:image/svg+xml') and browser.complaints == []
