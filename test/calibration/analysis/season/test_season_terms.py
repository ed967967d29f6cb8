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

"""The terms of a season: their wander, what moves them, what is foretold."""

import json
from xml.etree import ElementTree

import numpy as np
import pytest
from places import DATA

from calibration.analysis.finding import is_caution
from calibration.analysis.season.season_analysis import analyse_season
from calibration.analysis.season.season_causes import candidates, choose_causes
from calibration.analysis.season.season_kalman import (
    NightlyTerms,
    TermVariation,
    fit_variation,
    forecast,
    season_path,
)
from calibration.analysis.season.season_nights import Nights, SeasonNight, days, nights_of
from calibration.report.season_page import render_season
from calibration.report.wording import worded
from msg_tools.units import ARCSEC, DEG
from pointing_model.mounts import ALTAZ, Mount
from pointing_model.pointing_terms import design
from pointing_model.runs.columns.row_checks import Caution
from pointing_model.runs.run import PointingRun
from pointing_model.runs.run_reader import read_run

NAMES = ('IA', 'IE', 'TF')
ARC = DATA / 'arc35m'


def season(rng, count=24, walk=(1.0, 0.0, 0.0), scatter=(1.0, 3.0, 2.0), moved=None):
    day = np.sort(rng.uniform(0.0, 300.0, count))
    k = len(NAMES)
    level = np.cumsum(rng.standard_normal((count, k)) * walk
                      * np.sqrt(np.diff(day, prepend=day[0]))[:, None], axis=0)
    warm = 10.0 + 5.0 * rng.standard_normal(count)
    values = level + scatter * rng.standard_normal((count, k))
    if moved:
        moved(values, warm)
    values += 0.5 * rng.standard_normal((count, k))
    return Nights(NAMES, ALTAZ, [
        SeasonNight(f'night {i}', 1.7e9 + 86400.0 * d, 30, v * ARCSEC,
              np.eye(k) * (0.5 * ARCSEC)**2, ARCSEC, {'temperature': (float(t), 1.0)})
        for i, (d, v, t) in enumerate(zip(day, values, warm))], [])


def terms_of_nights(found):
    n, k = len(found.nights), len(found.names)
    return NightlyTerms(days(found.nights), np.array([night.values for night in found.nights]),
                        np.array([night.covariance for night in found.nights]),
                        np.zeros((n, k, 0)))


def test_walk_and_scatter_are_found_and_the_forecast_holds_its_sigma():
    walks, scatters, chi = [], [], []
    for trial in range(8):
        rng = np.random.default_rng([5, trial])
        nights = season(rng, 60)
        terms = terms_of_nights(nights)
        past = NightlyTerms(*(part[:-1] for part in terms))
        variation, _ = fit_variation(past)
        mean, cov = forecast(season_path(past, variation), variation,
                             terms.days[-1] - terms.days[-2], np.zeros((3, 0)))
        off = terms.values[-1] - mean
        chi.append(off @ np.linalg.solve(cov + terms.covariances[-1], off))
        walks.append(variation.walk / ARCSEC)
        scatters.append(variation.scatter / ARCSEC)
    assert np.median(walks, axis=0)[0] == pytest.approx(1.0, abs=0.15)
    assert np.all(np.median(walks, axis=0)[1:] < 0.1)
    assert np.median(scatters, axis=0)[1:] == pytest.approx([3.0, 2.0], rel=0.15)
    assert 11.5 < np.sum(chi) < 41.4  # 24 on the average; 1.5 % on either side


def test_levels_agree_with_the_weighted_mean_of_terms_that_stay():
    terms = terms_of_nights(season(np.random.default_rng(8), 9, walk=(0.0, 0.0, 0.0)))
    path = season_path(terms, TermVariation(np.full(3, 1e-9 * ARCSEC), np.full(3, 2.0 * ARCSEC)))
    assert path.levels == pytest.approx(np.tile(terms.values.mean(0), (9, 1)), abs=1e-3 * ARCSEC)
    sigma = np.sqrt((2.0**2 + 0.5**2) / 9.0) * ARCSEC
    assert np.sqrt(path.covariances[:, 1, 1]) == pytest.approx(sigma, rel=1e-3)


def test_a_season_that_only_wanders_has_no_cause():
    claimed = 0
    for trial in range(6):
        nights = season(np.random.default_rng([11, trial]), 20)
        terms = terms_of_nights(nights)
        claimed += bool(choose_causes(terms, candidates(nights, terms.days))[0])
    assert claimed == 0


@pytest.mark.parametrize('far', [1, 2])
def test_a_night_or_two_far_from_those_about_hide_no_cause(far):
    def moved(values, warm):
        values[:, 2] += 2.5 * (warm - 10.0)
        values[7:7 + far, 2] += 700.0

    judged = analyse_season(season(np.random.default_rng(13), 24, moved=moved),
                            causes={'temperature': 20.0})
    assert [(one.cause.kind, NAMES[one.cause.terms[0]]) for one in judged.causes] == [
        ('column', 'TF')]
    assert len(judged.season.nights) == 24 - far
    assert any('night 7' in note and 'TF is +7' in note for note in worded(judged.notes))
    # neither a step, if it is before the last night, nor what follows the temperature is one
    for trial, at in enumerate((12, 12, 12, 1, 22, 23)):
        def stepped(values, warm, at=at):
            values[at:, 1] += 80.0
            values[at + 2:, 1] += 80.0  # nor stairs
            values[:, 2] += 2.5 * (warm - 10.0)
        made = season(np.random.default_rng([17, trial]), 24, moved=stepped)
        assert len(analyse_season(made).season.nights) == 24


def test_what_moves_a_term_is_named_and_foretold_with():
    def moved(values, warm):
        values[:, 2] += 1.5 * (warm - 10.0)
        values[12:, 1] += 25.0

    nights = season(np.random.default_rng(13), 24, moved=moved)
    judged = analyse_season(nights, causes={'temperature': 20.0})
    kinds = {(f.cause.kind, NAMES[f.cause.terms[0]]) for f in judged.causes}
    assert kinds == {('column', 'TF'), ('step', 'IE')}
    document = json.loads(json.dumps(worded(judged.document())))
    found = {entry['kind']: entry for entry in document['causes']}
    slope, sigma = (found['column']['terms']['TF'][key][0] for key in ('arcsec', 'sigma_arcsec'))
    assert abs(slope - 1.5) < 4.0 * sigma < 1.0
    assert found['step']['what'] == 'night 12'
    assert 'TF vs temperature' in found['column']['sentence']
    assert document['tonight']['terms_arcsec']['TF'] == pytest.approx(15.0, abs=5.0)
    cold, unknown = analyse_season(nights), analyse_season(nights, causes={'temperature': np.nan})
    assert np.array_equal(cold.covariance, unknown.covariance) and cold.notes == unknown.notes
    assert not judged.notes and 'of 283 is far outside what was measured' in worded(
        analyse_season(nights, causes={'temperature': 283.0}).notes)[0]
    assert any('temperature of the coming night is unknown' in note
               for note in worded(cold.notes))
    assert abs(cold.mean[2] / ARCSEC) < 5.0
    # what the temperature scatters from night to night is in its error
    warm = np.array([night.causes['temperature'][0] for night in nights.nights])
    own, with_it = (np.sqrt(one.covariance[2, 2]) / ARCSEC for one in (judged, cold))
    assert with_it == pytest.approx(np.hypot(own, 1.5 * np.std(warm)), rel=0.15)
    assert judged.model().covariance == pytest.approx(judged.covariance)
    page = render_season(judged, ())
    ElementTree.fromstring(page.removeprefix('<!DOCTYPE html>\n'))
    assert 'per unit of temperature' in page and '://' not in page
    with pytest.raises(ValueError, match='ask for a later one'):
        analyse_season(nights, tonight=0.0)
    with pytest.raises(ValueError, match='no column|no night has a column'):
        analyse_season(nights, causes={'wind': 3.0})


def test_steps_of_one_term_do_not_hide_one_another():
    def moved(values, warm):
        for night, size in zip((2, 9, 14, 19), (45.0, -50.0, 40.0, -45.0)):
            values[night:, 1] += size

    nights = season(np.random.default_rng(27), 24, moved=moved)
    terms = terms_of_nights(nights)
    found, variation = choose_causes(terms, candidates(nights, terms.days))
    assert all(entry.cause.terms == (1,) and entry.p < 1e-3 for entry in found)
    assert sorted(entry.cause.first for entry in found) == [2, 9, 14, 19]
    assert variation.walk[1] < 0.5 * ARCSEC  # what the steps do is no walk


def test_what_a_few_nights_run_through_is_no_cause():
    nights = season(np.random.default_rng(29), 24)
    for i, night in enumerate(nights.nights):
        night.causes['rotator_deg'] = (60.0, 75.0) if i < 2 else (0.0, 0.0)
    asked = [entry.text for entry in candidates(nights, days(nights.nights))
             if entry.kind == 'column']
    assert asked == ['temperature'] * 3


@pytest.mark.skipif(not ARC.is_dir(), reason='the runs of the ARC 3.5 m are not in the package')
def test_the_steps_of_a_measured_season_are_found_with_their_dates():
    runs = []
    for path in sorted(ARC.glob('*.dat')):
        try:
            runs.append(read_run(path))
        except ValueError:  # one has no rows
            continue
    whole = nights_of(runs)
    place = whole.names.index('IE')
    alone = Nights(('IE',), whole.mount, [night._replace(
        values=night.values[[place]], covariance=night.covariance[[place]][:, [place]])
        for night in whole.nights], [])
    terms = terms_of_nights(alone)
    found, _ = choose_causes(terms, candidates(alone, terms.days))
    steps = {entry.cause.text[7:14] for entry in found if entry.cause.kind == 'step'}
    # the first night with it: 2014-06/08, 2015-06/07, 2016-06/07, 2018-05/09, 2019-06/07
    assert steps == {'2014-08', '2015-07', '2016-07', '2018-09', '2019-07'}
    assert len(found) == 5


def test_a_declared_date_moves_all_terms_at_once():
    def moved(values, warm):
        values[9:] += [6.0, -9.0, 6.0]

    nights = season(np.random.default_rng(17), 22, walk=(0.0, 0.0, 0.0), moved=moved)
    when = 0.5 * (nights.nights[8].time + nights.nights[9].time)
    found = analyse_season(nights, declared=[(when, 'mirror back')]).causes
    assert found[0].cause.kind == 'declared' and found[0].cause.terms == (0, 1, 2)


def run_of(rng, terms, when=None, count=30, **meta):
    az, el = rng.uniform(-3.0, 3.0, count), rng.uniform(20.0, 80.0, count) * DEG
    x, y = (columns.T @ (np.array(list(terms.values())) * ARCSEC)
            for columns in map(np.transpose, design(tuple(terms), az, el)))
    columns = {'az': az, 'el': el,
               'az_enc': az + (x + ARCSEC * rng.standard_normal(count)) / np.cos(el),
               'el_enc': el + y + ARCSEC * rng.standard_normal(count)}
    if when is not None:
        columns['time'] = when + 60.0 * np.arange(count)
    return PointingRun(columns, meta={'notes': [], **meta})


def test_nights_have_their_dates_and_say_what_is_left_out():
    rng, terms = np.random.default_rng(19), {'IA': 30.0, 'IE': -20.0, 'TF': 40.0}
    two = [run_of(rng, terms, 1.7e9 + 86400.0 * i) for i in (0, 1)]
    whole = PointingRun({name: np.concatenate([run[name] for run in two])
                         for name in two[0].columns}, meta={'notes': [], 'source': 'log.csv'})
    runs = [whole, run_of(rng, terms, source='run_2024-03-01T05-06-07.dat'),
            run_of(rng, terms, source='nameless.dat'),
            run_of(rng, terms, count=4, source='run_2024-03-02.dat'),
            run_of(rng, terms, 0.0, source='run_2024-03-03.csv'),  # seconds from its start
            run_of(rng, terms, 0.0, source='clock.csv')]
    for i, run in enumerate(runs[1:]):
        run.meta['notes'].append(Caution(f'first in row {i}: kelvin?'))
    found = nights_of(runs, tuple(terms))
    assert [night.source for night in found.nights] == [
        'log.csv (1)', 'log.csv (2)', 'run_2024-03-01T05-06-07.dat', 'run_2024-03-03.csv']
    assert found.nights[2].time == 1709269567.0
    assert found.nights[0].values / ARCSEC == pytest.approx(list(terms.values()), abs=4.0)
    caution, *left = worded(found.notes)
    assert caution == 'run_2024-03-01T05-06-07.dat and 4 more: first in row 0: kelvin?'
    assert is_caution(caution) and len(left) == 3
    assert 'nameless.dat: left out, no date' in left[0] and '4 rows for 3 terms' in left[1]
    assert 'clock.csv: left out, no date' in left[2] and 'give UTC' in left[2]
    with pytest.raises(ValueError, match='a season takes three'):
        nights_of(runs[1:], tuple(terms))
    other = run_of(rng, terms, 1.7e9, source='b')
    other.meta['mount'] = Mount.equatorial(30.0 * DEG)
    with pytest.raises(ValueError, match='b is of another mount'):
        nights_of([runs[0], other], tuple(terms))


def test_a_night_that_two_files_have_counts_once():
    rng, terms = np.random.default_rng(20), {'IA': 30.0, 'IE': -20.0, 'TF': 40.0}
    runs = [run_of(rng, terms, 1.7e9 + 86400.0 * i, source=f'{i}.csv') for i in range(4)]
    again = PointingRun(dict(runs[1].columns), {'notes': [], 'source': 'copy.csv'})
    found = nights_of([*runs, again], tuple(terms))
    assert [night.source for night in found.nights] == [f'{i}.csv' for i in range(4)]
    assert 'copy.csv left out: all 30 rows are also in 1.csv' in found.notes
