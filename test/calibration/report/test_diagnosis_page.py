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

"""The page of a diagnosis: what it says, that it stands alone, that no name in it can do harm."""

import re
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from html.parser import HTMLParser
from types import SimpleNamespace

import numpy as np
import pytest

from calibration.analysis.diagnosis.diagnosis import diagnose
from calibration.report.diagnosis_page import render
from calibration.report.diagnosis_sections import exclusions, next_observations, ranking
from calibration.report.diagnosis_summary import DiagnosisSummary
from calibration.report.diagnosis_view import (
    DiagnosisView,
    Driver,
    FoundEffect,
    _ranking,
    driver_of,
    view_of,
)
from calibration.report.drawing import Panel, limit_of, ticks
from calibration.report.effect_wording import effect_summaries
from calibration.report.figure_wording import best_pair
from calibration.report.observation_wording import proposal_groups
from calibration.report.page_html import drawn
from calibration.report.residuals import Residuals
from calibration.report.sky_map import SkyMap, grid_of
from calibration.report.verdict_wording import Statement, verdict_sentences
from msg_tools.units import ARCSEC, DEG
from pointing_model.context import Context
from pointing_model.effects import Amount, changes, dictionary, effect, smooths, steps
from pointing_model.effects.base import arcsec, readable
from pointing_model.mount_kinds import KINDS
from pointing_model.mounts import Mount
from pointing_model.rms import rms_arcsec
from pointing_model.runs.run import PointingRun

EVIL = '"><script>alert(1)</script><img src=x onerror=alert(2)>\x07\u202e'
TAGS = {'html', 'head', 'meta', 'title', 'style', 'body', 'main', 'section', 'h1', 'h2', 'h3', 'p',
        'ul', 'li', 'div', 'span', 'b', 'i', 'dl', 'dt', 'dd', 'figure', 'figcaption', 'table',
        'thead', 'tbody', 'tr', 'th', 'td', 'details', 'summary', 'footer', 'svg', 'g', 'path',
        'rect', 'circle', 'text', 'caption', 'script', 'fieldset', 'legend', 'label', 'input',
        'output', 'select', 'option'}
ATTRIBUTES = {'class', 'style', 'lang', 'charset', 'name', 'content', 'viewbox', 'role',
              'aria-label', 'data-h', 'd', 'x', 'y', 'width', 'height', 'rx', 'cx', 'cy', 'r', 'dy',
              'text-anchor', 'transform', 'http-equiv', 'data-i', 'data-g', 'data-say', 'scope',
              'aria-sort', 'aria-live', 'id', 'type', 'value', 'checked', 'hidden', 'data-arrows',
              'data-refit', 'data-rms', 'data-when', 'data-x', 'data-y'}


class Inventory(HTMLParser):
    """Tags and attributes as a browser sees them."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.attributes, self.headings, self._in = set(), set(), [], None
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        self.attributes |= {name for name, _ in attrs}
        self._in = tag

    def handle_data(self, data):
        if self._in == 'h2':
            self.headings.append(data)

    def handle_endtag(self, tag):
        self._in = None


def sky(n, seed, size=4.0):
    """A run with hysteresis of azimuth of `size` arcsec each way."""
    rng = np.random.default_rng(seed)
    az, el = rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(0.3, 0.98, n))
    side = rng.choice([-1.0, 1.0], n)
    x, y = rng.normal(size=(2, n)) * ARCSEC
    return PointingRun({
        'time': 1.7e9 + np.sort(rng.uniform(0, 3e4, n)), 'az': az, 'el': el,
        'star': np.array([f'{EVIL} {i}' for i in range(n)]),
        'az_enc': az + 30 * ARCSEC + (x + size * side * ARCSEC) / np.cos(el), 'el_enc': el + y,
        'approach_az': side, 'approach_el': rng.choice([-1.0, 1.0], n), EVIL: rng.normal(size=n),
    }, {'drivers': (EVIL,), 'source': f'/some/where/{EVIL}.csv', 'notes': [EVIL],
        'lines': np.arange(n) + 2, 'excluded': [{'row': 7, 'reason': EVIL}] * 2})


@pytest.fixture(scope='module')
def diagnosis():
    return diagnose(sky(60, 1), flips=199, cross_validation=False)


@pytest.fixture(scope='module')
def page(diagnosis):
    return render(view_of(diagnosis))


# -------------------------------------------------------------------------------- the whole page

def test_it_is_well_formed(page):
    assert page.startswith('<!DOCTYPE html>\n<html lang="en">')
    root = ElementTree.fromstring(page.split('\n', 1)[1])
    assert root.tag == 'html'
    for drawing in root.iter('svg'):
        assert drawing.get('viewBox') and drawing.get('aria-label')


def test_it_stands_alone(page):
    lower = page.lower()
    for word in ('://', 'url(', '@import', 'srcset', '<link', '<iframe', '<object'):
        assert word not in lower.replace(EVIL.lower(), '').replace('todataurl(', ''), word


def test_no_name_can_do_harm(page):
    seen = Inventory(page)
    assert seen.tags <= TAGS, seen.tags - TAGS
    assert seen.attributes <= ATTRIBUTES, seen.attributes - ATTRIBUTES
    assert '&lt;script&gt;alert(1)' in page and '\x07' not in page and '\u202e' not in page


def way_start(diagnosis):
    """RMS of what the encoders read, as text."""
    run = diagnosis.observations.run
    return f'{rms_arcsec(*run.offsets("enc")).radial:.1f}'


def test_everything_is_in_it_in_order(page, diagnosis):
    headings = Inventory(page).headings
    before, after = (arcsec(getattr(diagnosis, key)['rms_arcsec']) for key in ('before', 'after'))
    found, = effect_summaries(diagnosis)
    name = view_of(diagnosis).effects[0].name
    assert headings == [
        f'{name}, {arcsec(found.reach_arcsec)} peak to peak. The only error beyond the 7-term '
        'model of an alt-azimuth mount.',
        'Largest errors', 'Evidence', 'RMS', 'Effects', 'Residuals by driver', 'Target',
        'Histograms', 'Candidate effects', 'Terms', 'Stars', 'Notes on the data', 'Excluded rows',
        'Not testable']
    removed = arcsec(diagnosis.effects[0].removes_arcsec)
    assert f'peak to peak, {removed} RMS on the sky.' in found.lead
    assert f'<span>{after} after</span>' in page and f'<span>{before} before</span>' in page
    assert '<h1>Pointing diagnosis: ' in page
    assert f'{way_start(diagnosis)}″</b><span>raw' in page
    assert '>Correlations</h3>' in page and '7 terms</p>' in page
    assert page.count('<svg') >= 1 + 2 + 1 + 2 * 5 + 2


class Words(HTMLParser):
    """Words of a page: all of them, and those that are in sight with all parts folded."""

    def __init__(self, text):
        super().__init__()
        self.all, self.open, self._inside = 0, 0, []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        if tag in ('style', 'script', 'title', 'head', 'details', 'summary'):
            self._inside.append(tag)

    def handle_endtag(self, tag):
        if tag in self._inside:
            self._inside.remove(tag)

    def handle_data(self, data):
        if {'style', 'script', 'title', 'head'} & set(self._inside):
            return
        count = sum(any(map(str.isalpha, word)) for word in data.split())
        self.all += count
        closed = self._inside.count('details') - self._inside.count('summary')
        self.open += 0 if closed > 0 else count


def test_a_page_has_few_words(page):
    words = Words(page)
    assert words.open <= 250 and words.all <= 1500


def test_the_finding_is_said_in_plain_words(page, diagnosis):
    assert diagnosis.verdict == 'identified'
    found, = diagnosis.effects
    size = 2 * abs(found.fitted.coefficients[0]) / ARCSEC
    assert size == pytest.approx(8.0, abs=1.0)
    assert (f'The azimuth axis reads {arcsec(size)} more across the line of sight when the last '
            'motion was clockwise than when it was anticlockwise'
            ) in effect_summaries(diagnosis)[0].lead
    assert 'preload of the azimuth drive' in page
    for key in ('before', 'after'):
        assert arcsec(getattr(diagnosis, key)['rms_arcsec']) in page


def test_two_sides_have_a_sign_and_say_where_they_come_from(page, diagnosis):
    found, = diagnosis.effects
    cause = {'cause': 'backlash', 'shape': found.fitted.effect.shape, 'effects': ['a'],
             'delta_bic': 9.0, 'look_at': 'the gear', 'effort': 1}
    open_ = replace(diagnosis, effects=[replace(found, causes=[
        cause, {**cause, 'cause': 'play', 'effort': 0}])])
    told, = effect_summaries(open_)
    size = 2 * abs(found.fitted.coefficients[0]) / ARCSEC
    assert told.lead.startswith(
        'The azimuth error has a difference by the direction of the last motion, '
        f'{arcsec(size)} more on the sky after moving clockwise than anticlockwise, on average')
    assert told.more == 'Two causes explain it equally well. (1) Backlash. (2) Play.'
    # a column of the file; or the order of the rows
    run = diagnosis.observations.run
    derived = replace(open_, observations=replace(diagnosis.observations, run=PointingRun(
        run.columns, {**run.meta, 'approach_from': {'axes': ['az'], 'order': 'rows'}})))
    assert 'no column of the file: it was derived from the order of the rows' in \
        effect_summaries(derived)[0].text
    assert 'dots: with the residual, spread sideways' in page


def test_the_view_holds_the_figures(diagnosis):
    view = view_of(diagnosis)
    assert view.residuals.before == pytest.approx(diagnosis.residual_before / ARCSEC)
    effect, = view.effects
    # what the effect moves, beside what is left: together the residual without it
    side = diagnosis.observations.run['approach_az']
    coefficient = diagnosis.effects[0].fitted.coefficients[0] / ARCSEC
    assert effect.fitted[0] == pytest.approx(coefficient * side)
    assert effect.driver.levels == {-1: 'anticlockwise', 1: 'clockwise'}
    assert view.residuals.names[3].startswith('line 5, star')
    assert [d.name for d in view.drivers] == [
        'approach_az', 'azimuth', 'elevation', 'time', 'approach_el', EVIL]
    assert view.drivers[3].values.max() < 9 and view.drivers[3].label.endswith('UTC [h]')


def test_terms_and_correlations_belong_together(diagnosis):
    view = view_of(diagnosis)
    assert [t['name'] for t in view.terms][:2] == ['IA', 'IE']
    ia = view.terms[0]
    assert ia['value'] == pytest.approx(30.0, abs=5 * ia['sigma'])
    assert view.correlated == ['IA', 'IE', 'CA', 'NPAE', 'AN', 'AW', 'TF', 'azimuth hysteresis']
    matrix = view.correlations
    assert np.diag(matrix) == pytest.approx(np.ones(8)) and np.abs(matrix).max() < 1 + 1e-9
    model = diagnosis.model.covariance
    size = np.sqrt(np.diag(model))
    assert matrix[:7, :7] == pytest.approx(model / np.outer(size, size), abs=0.05)


def test_a_clean_run_says_so():
    clean = diagnose(sky(50, 3, size=0.0), flips=199, cross_validation=False)
    assert clean.verdict == 'none'
    text = render(view_of(clean))
    assert 'No significant error beyond the 7-term model of an alt-azimuth mount.' in text
    assert 'What was added' not in text and 'What to observe next' not in text
    assert 'what the added effects take away' not in text
    ElementTree.fromstring(text.split('\n', 1)[1])


def test_many_rows_stay_small():
    rng = np.random.default_rng(0)
    n = 50000
    before, after = rng.normal(size=(2, 2, n))
    rms = {'rms_arcsec': 1.4, 'rms_x_arcsec': 1.0, 'rms_y_arcsec': 1.0, 'cv_rms_arcsec': None,
           'holdout_rms_arcsec': None}
    el = rng.uniform(0.3, 1.5, n)
    driver = Driver('elevation', 'elevation [°]', el / DEG)
    view = DiagnosisView({'observations': n, 'runs': 1, 'base_terms': ['IA'], 'verdict': 'unknown',
                 'before': rms, 'after': rms, 'noise_floor_arcsec': np.nan, 'effects': []},
                Residuals(['a star'] * n, rng.uniform(0, 6.28, n), el, before, after,
                          np.ones(n, bool)), [driver],
                [FoundEffect('x', Statement('Y.'), [], *[before - after] * 2, driver)], [], [],
                DiagnosisSummary('Z', [], '', [], [], ''))
    text = render(view)
    assert len(text) < 1_500_000
    assert '400 of 50000 rows drawn' in text


# ------------------------------------------------------------------------------------- the words

@pytest.mark.parametrize('value, more, less', [(1.35, 'clockwise', 'anticlockwise'),
                                               (-1.35, 'anticlockwise', 'clockwise')])
def test_hysteresis_in_words(value, more, less):
    text = effect('hysteresis', axis='az', shape='cosE').clause(
        Amount(np.array([value]), 1.0))
    assert text.startswith(f'The azimuth axis reads 2.70″ more when the last motion was {more} '
                           f'than when it was {less}')


@pytest.mark.parametrize('form, parameters, values, span, words', [
    ('drift', {'of': 'IE', 'driver': 'temperature'}, [-0.5], (2.0, 12.0),
     'zero of the elevation axis moves 0.50″ a degree, 5.00″ for the 10.0 °C'),
    ('drift', {'of': 'IA', 'driver': 'time', 'scale': 3600.0}, [2.0], (0.0, 7200.0),
     'zero of the azimuth axis moves 2.00″ an hour, 4.00″ in the whole run'),
    ('step', {'axis': 'el', 'at': 5.0}, [-8.25], None, 'elevation axis jumped by −8.25″ at 5.0'),
    ('encoder', {'axis': 'az', 'order': 2}, [3.0, 4.0], None,
     'is read wrong twice per turn; one cause: the disc'),
    ('polynomial', {'result': 'az', 'of': 'az', 'power': 1, 'mount': 'german'}, [-60.2], None,
     'hour angle error falls with the hour angle, by 60.2″ per radian, 1.05″ a degree'),
    ('run_zero', {'axis': 'az', 'runs': [1, 2, 3]}, [4.0, -3.0], None, 'by up to 7.00″'),
    ('latency', {}, [-0.15], None, '0.150 s too early'),
    ('proportional', {'axis': 'el', 'driver': 'magnitude'}, [0.3], None, '+0.30″ a magnitude'),
    ('proportional', {'axis': 'el', 'driver': 'fan', 'scale': 2.0}, [1.5], (0.0, 8.0),
     'column fan of the file: +6.00″'),
    ('smooth', {'axis': 'az', 'driver': 'elevation', 'shape': 'bump', 'centre': 1.0,
                'width': 0.1}, [1.0], None, 'no known effect explains'),
])
def test_effects_in_words(form, parameters, values, span, words):
    assert words in effect(form, **parameters).clause(
        Amount(np.array(values), 3.0, span, str))


def test_every_form_has_words():
    run = sky(40, 5)
    columns = {**run.columns, 'temperature': run['az'], 'magnitude': run['el'],
               'pier_side': run['approach_az'], 'miss_x': run['az'], 'miss_y': run['el'],
               'run': np.arange(40) % 3, 'star': np.arange(40) + 1, 'fan': run['el']}
    columns.pop(EVIL)
    context = Context.from_run(PointingRun(columns, {'site': {'latitude': 0.6, 'longitude': 0.1}}))
    effects = dictionary(context)[0] + steps(context)[:1] + smooths(context)[:30]
    effects += changes(effects[0], context)
    assert len({e.form for e in effects}) > 14
    for e in effects:
        text = e.clause(Amount(np.ones(len(e.coefficient_names)), 1.0, (0.0, 1.0), str))
        assert text[0].isupper() and not text.endswith('.')
        assert '_' not in text.replace('pier_side', '') and '{' not in text


def test_the_most_honest_pair_is_quoted():
    before = {'rms_arcsec': 5.0, 'cv_rms_arcsec': 6.0, 'holdout_rms_arcsec': 7.0}
    after = {'rms_arcsec': 1.0, 'cv_rms_arcsec': 2.0, 'holdout_rms_arcsec': 3.5}
    assert best_pair({'before': before, 'after': after}) == ('on held-out runs', 7.0, 3.5)
    after['holdout_rms_arcsec'] = None
    assert best_pair({'before': before, 'after': after})[1:] == (6.0, 2.0)
    document = {'verdict': 'ambiguous', 'before': before, 'after': after,
                'effects': [{'name': 'a_b', 'alternatives': ['azimuth_encoder_2', 'c']}]}
    headline, sentences = verdict_sentences(document, [Statement('A is off.')])
    assert headline == ('A is off. The only error found beyond the terms of the model. RMS 2.00″ '
                        'with it, cross-validated (6.00″ without, −67 %)')
    assert sentences[:2] == [
        'One effect found; the cause is open.',
        'A is off. With these observations it could as well be: azimuth encoder, 2 per turn; or '
        'c.']
    # the one that removes most is told first
    document['effects'] = [{'name': name, 'cv_gain_arcsec': gain}
                           for name, gain in (('a', 1.0), ('b', 5.0), ('c', None))]
    told = verdict_sentences(document, [Statement(f'{name}.') for name in 'ABC'], limit=2)
    assert told[0].startswith('B. Largest of three errors beyond')
    assert [text[:4] for text in told[1][1:4]] == ['1. B', '2. A', 'And ']
    assert told[1][1] == '1. B.'


def test_numbers_and_names():
    assert [arcsec(v) for v in (0.123, 9.99, 10.04, 123.4, None, np.nan)] == [
        '0.12″', '9.99″', '10.0″', '123″', '?', '?']
    assert arcsec(-2.0, True) == '−2.00″' and arcsec(2.0, True) == '+2.00″'
    assert readable('azimuth_hysteresis_cosE_memory_10deg') == \
        'azimuth hysteresis, × cos E, memory 10°'
    assert readable('hour_angle_hysteresis_cosE') == 'hour angle hysteresis, × cos δ'
    assert readable('declination_nod_5_by_side') == \
        'declination nod, 5 per turn, by side of the pier'
    assert readable('smooth_of_time_az_spline_3_cosE') == \
        'azimuth by a curve of time, spline 3, × cos E'
    assert readable('smooth_of_hour_angle_declination_bump') == \
        'declination by a curve of hour angle, bump'


# ----------------------------------------------------------------------------------- the drawings

@pytest.mark.parametrize('az, x, y, sign', [
    (90.0, 1.0, 0.0, (0, 1)), (90.0, 0.0, 1.0, (-1, 0)),  # in the east: south, inward
    (0.0, 1.0, 0.0, (1, 0)), (0.0, 0.0, 1.0, (0, 1)),  # in the north: east, inward
])
def test_arrows_point_where_the_offset_is(az, x, y, sign):
    drawn = SkyMap(400, 0.0)
    drawn.parts.clear()
    drawn.arrows(np.array([az * DEG]), np.array([0.7]), np.array([x]), np.array([y]), 30.0,
                 'after', ['a'])
    move = ''.join(drawn.parts).split('<path d="M')[1].split('l')[1].split('M')[0].split()
    assert [round(float(v) / 30.0) for v in move] == list(sign)


def test_north_is_up_and_east_to_the_right():
    x, y = SkyMap(400, 0.0).place(np.array([0.0, 90.0]) * DEG, np.array([0.1, 0.1]))
    assert x[0] == pytest.approx(200) and y[0] < 60 and x[1] > 340 and y[1] == pytest.approx(200)


def test_both_maps_have_one_scale(page):
    keys = re.findall(r' key" d="M[-\d]+ \d+h([\d.]+)"', page)
    assert len(keys) == 2 and keys[0] == keys[1] and float(keys[0]) > 10


def test_points_beyond_the_frame_are_drawn_at_its_edge():
    panel = Panel((0, 0, 100, 100), (0, 1), (-1, 1))
    panel.points([0.5, 0.5], [0.0, 9.0], 'before')
    assert panel.parts[0].count('h0') == 1
    assert 'beyond' in panel.parts[1] and '9.0 arcsec' in panel.parts[1]
    assert limit_of(np.r_[np.random.default_rng(0).normal(size=500), 400.0]) < 10


def test_ticks_are_round():
    assert ticks(-1.03, 4.7, 5) == pytest.approx([0, 2, 4])
    assert ticks(0.0, 0.0) == pytest.approx([0.0])
    assert np.isfinite(ticks(-1e-9, 1e12)).all()


def test_drivers_that_cannot_be_drawn_are_left_out():
    az = np.linspace(0.1, 6.0, 9)
    context = Context(az, np.full(9, 0.5), {'flat': np.ones(9), 'gone': np.full(9, np.nan),
                                            'fan': np.where(az > 1, az, np.nan)})
    assert driver_of(context, 'flat') is None and driver_of(context, 'gone') is None
    assert driver_of(context, 'elevation') is None and driver_of(context, 'missing') is None
    assert np.isnan(driver_of(context, 'fan').values).sum() == (az <= 1).sum()
    assert driver_of(context, 'azimuth').values == pytest.approx(az / DEG)


def test_tables():
    text = drawn(exclusions([{'row': i, 'reason': 'cloud'} for i in range(20)]
                            + [{'row': 3, 'reason': 'a < b', 'source': 'x/one.csv'}]))
    assert '<td>20</td>' in text and 'and 8 more' in text and 'a &lt; b' in text
    assert text.index('cloud') < text.index('a &lt;')
    two = drawn(exclusions([{'row': 3, 'reason': 'r', 'source': f'x/{name}'}
                            for name in ('a', 'b')]))
    assert 'a:3, b:3' in two
    rows = [{'name': f'e_{i}', 'driver': 'time', 'axes': 'az', 'delta_bic': 30.0 - i,
             'p_family': 0.001 if i < 2 else None, 'in_set': i < 2} for i in range(20)]
    text = drawn(ranking(rows))
    assert text.count('<td>●</td>') == 2 and '14 more in the JSON result' in text
    assert 'width:100%' in text and text.index('e 0') < text.index('e 1')
    # a p beside a gain that no search took says nothing that a reader could check
    assert '0.001' not in text and 'p (family' not in text
    text = drawn(next_observations(proposal_groups({'effects': [], 'next_observations': [{
        'az_deg': 90.0, 'el_deg': 30.0, 'approach_az': -1, 'approach_el': 1, 'after_hours': None,
        'separates': ['a_b', 'c'], 'separation_before': 2.0, 'separation_after': 9.25}]})))
    assert 'anticlockwise, upward' in text and '<li>a b</li><li>c</li>' in text
    assert 'hours' not in text
    assert 'ΔBIC between them is 2.0, expected 9.2 with it.' in text
    assert next_observations([]) is None


def test_equatorial_words_on_the_page():
    # whatever belongs to an axis is called as the axes of that mount are
    rng = np.random.default_rng(4)
    n = 60
    mount = Mount.equatorial(34.0 * DEG)
    ha, dec = rng.uniform(-60, 60, n) * DEG, rng.uniform(-20, 70, n) * DEG
    x, y = rng.normal(size=(2, n)) * ARCSEC
    side = rng.choice([-1.0, 1.0], n)
    run = PointingRun({
        'az': ha, 'el': dec, 'az_enc': ha + (x + 8.0 * side * ARCSEC) / np.cos(dec),
        'el_enc': dec + y, 'approach_az': side, 'approach_el': rng.choice([-1.0, 1.0], n),
    }, {'source': 'fork.csv', 'notes': [], 'lines': np.arange(n) + 2, 'excluded': [],
        'mount': mount})
    view = view_of(diagnose(run, flips=199, cross_validation=False))
    assert [e.name for e in view.effects] == ['Hour angle hysteresis']
    shown = {d.name: d for d in view.drivers}
    assert shown['approach_az'].label == 'last motion of the polar axis'
    assert set(shown['approach_az'].levels.values()) == {'eastward', 'westward'}
    assert shown['approach_el'].label == 'last motion of the declination axis'
    rows = view.ranking
    assert {row['axes'] for row in rows} <= {'hour angle', 'declination', 'both'}
    assert 'approach hour angle' in {row['driver'] for row in rows}
    assert not any((row['driver'] or '').endswith(('_az', '_el')) for row in rows)
    # what noise explains as well is marked under whatever name the axes have
    drift = {'like': ['declination_zero_step'], **dict.fromkeys(('p', 'axes'), {})}
    like = [{'name': name, 'driver': 'time', 'axes': 'el', 'delta_bic': 9.0, 'in_set': False}
            for name in ('declination_zero_step', 'declination_zero_with_time')]
    marked = _ranking(SimpleNamespace(noise_memory=drift, ranking=like), mount)
    assert [row['or_noise'] for row in marked] == [True, False]
    assert '<td>~</td>' in drawn(ranking(marked))


GERMAN = Mount.equatorial(34.0 * DEG, 'german')


def _axes_drawn(sky):
    """Ends of the lines along which an axis stands still, shape (n, 2), and what is said there."""
    lines = [part for part in sky.parts if 'class="grid axes"' in part]
    ends = [np.array(xy.split(), float) for path in lines
            for xy in re.findall(r'[ML](-?[0-9.]+ -?[0-9.]+)', path)]
    said = {one[3]: np.array([float(one[1]), float(one[2])]) for part in sky.parts
            if (one := re.search(r'class="axes".* x="(.*)" y="(.*)">(.*)<', part))}
    return np.array(ends), said


@pytest.mark.parametrize('lowest', [0.0, 30.0])
def test_a_map_of_an_equatorial_mount_has_its_axes(lowest):
    sky = SkyMap(400, lowest, grid_of(GERMAN))
    ends, said = _axes_drawn(sky)
    distance = np.hypot(*(ends - sky.centre).T)
    assert len(ends) > 200 and distance.max() <= sky.radius + 0.1
    # all hour circles meet at the pole, due north at the elevation of the latitude
    pole = np.array(sky.place(0.0, 34.0 * DEG))
    assert np.sum(np.hypot(*(ends - pole).T) < 0.1) == 12
    assert np.hypot(*(said['pole'] - pole)) < 6.0 and said['δ 30°'][1] < said['δ 0°'][1]
    assert said['h -30°'][0] > sky.centre > said['h 30°'][0]  # rising in the east


def test_a_map_of_an_altazimuth_mount_has_none():
    assert _axes_drawn(SkyMap(400, 0.0, grid_of(Mount())))[0].size == 0


def test_next_observations_of_an_equatorial_mount():
    row = {'az_deg': 90.0, 'el_deg': 30.0, 'approach_az': -1, 'approach_el': 1,
           'through_pole': True, 'separates': ['a', 'b']}

    def text_of(row):
        document = {'effects': [], 'mount': 'german', 'next_observations': [row]}
        return drawn(next_observations(proposal_groups(document), KINDS['german']))
    text = text_of(row)
    assert 'through the pole, eastward, toward larger readings' in text
    assert 'through the pole' not in text_of({**row, 'through_pole': False})
