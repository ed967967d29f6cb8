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

"""What a fit and a diagnosis tell of places visited again and of outliers that lie together."""

import numpy as np
import pytest
from noisy_run import make_run
from simulated import night

from calibration.analysis.diagnosis.diagnosis import diagnose
from calibration.analysis.diagnosis.residual_patterns import (
    ResidualRows,
    jump_findings,
    memory_findings,
)
from calibration.analysis.diagnosis.sessions import arrange, split_at_steps
from calibration.analysis.finding import Finding
from calibration.analysis.run_fit import fit_run
from calibration.analysis.term_fit import fit_terms
from calibration.report.documents import fit_document
from calibration.report.wording import wording
from msg_tools.units import ARCSEC, DEG
from pointing_model.geometry import sky_to_encoder
from pointing_model.model import PointingModel
from pointing_model.model_application import axis_angles
from pointing_model.mounts import ALTAZ, Mount, through_pole
from pointing_model.runs.run import PointingRun
from pointing_model.runs.run_reader import read_run

GERMAN = Mount.equatorial(34.3 * DEG, 'german')


def two_passes(seed=2, mount=ALTAZ, places=20, size=-38.0, zeros=None):
    """A run over the same sky twice; the zero of the first axis is `size` arcsec off after it."""
    rng = np.random.default_rng(seed)
    az = rng.uniform(0.0, 2.0 * np.pi, places)
    el = np.arcsin(rng.uniform(0.35, 0.97, places))
    order = np.concatenate([rng.permutation(places) for _ in range(2)])
    first, second = (az, el) if mount.vertical else mount.on_travel(*through_pole(
        *mount.axes_of(az, el), np.sin(mount.axes_of(az, el)[0]) < 0.0))
    n = 2 * places
    first, second = first[order] + rng.normal(0.0, 1e-4, n), second[order]
    terms = dict.fromkeys(mount.names.index, 20.0 * ARCSEC)
    readings = np.array(sky_to_encoder(first, second, terms, mount))
    readings += ARCSEC * rng.normal(size=(2, n)) / [np.cos(second), np.ones(n)]
    readings[0] += ARCSEC * (size * (np.arange(n) >= places) if zeros is None else zeros(rng, n))
    return PointingRun({'az': first, 'el': second, 'az_enc': readings[0], 'el_enc': readings[1],
                        'time': 1.7e9 + 90.0 * np.arange(n)}, {'mount': mount})


def kinds(findings):
    return [one.kind for one in findings if not isinstance(one, str)]


@pytest.mark.parametrize('mount', [ALTAZ, GERMAN], ids=['altaz', 'german'])
def test_a_fit_tells_a_step_between_two_passes_and_fits_zeros_to_each(mount):
    found = fit_run(two_passes(mount=mount))
    (step,) = [one for one in found.findings if kinds([one]) == ['step between visits']]
    assert abs(step.size + 38.0) < 4.0 * step.sigma and step['axis'] == mount.names.axes[0]
    assert (step['before'], step['after']) == (19, 20) and step['places'] >= 18
    assert step.before > 5.0 * step.after
    assert 'a step' in wording(step) and '--sessions auto' in wording(step)
    apart = fit_run(two_passes(mount=mount), sessions=None)
    assert apart.terms.names[-2:] == tuple(f'{t}[2]' for t in mount.names.index)
    assert apart.terms.coefficients[-2] / ARCSEC == pytest.approx(-38.0, abs=2.0)
    assert apart.halves.radial < 0.2 * found.halves.radial
    assert {'step between visits', 'places visited again'} <= set(kinds(apart.findings))
    assert any('A session with new zeros begins there' in note
               for note in fit_document(apart)['notes'])


def test_a_zero_that_drifts_has_moved_and_begins_no_session():
    run = two_passes(zeros=lambda rng, n: 15.0 * np.arange(n) / n)
    found = fit_run(run)
    (moved,) = [one for one in found.findings if 'between visits' in getattr(one, 'kind', '')]
    assert moved.kind == 'moved between visits' and 'drift' in wording(moved)
    assert 'run' not in split_at_steps(run) and 'run' not in arrange(run).runs[0]


def few_places(seed, steps, **meta):
    """96 rows over eight places; `steps` of both zeros: row -> arcsec from there on."""
    rng = np.random.default_rng(seed)
    n, place = 96, np.concatenate([rng.permutation(8) for _ in range(12)])
    az = np.pi / 4.0 * place + rng.normal(0.0, 0.005, n)
    el = np.arcsin(rng.uniform(0.35, 0.97, 8))[place]
    readings = np.array(sky_to_encoder(az, el, {'IA': 20.0 * ARCSEC, 'AN': 12.0 * ARCSEC}))
    zeros = np.sum([size * (np.arange(n) >= row) for row, size in steps.items()], axis=0)
    readings += ARCSEC * (zeros + rng.normal(size=(2, n)) / [np.cos(el), np.ones(n)])
    return PointingRun({
        'az': az, 'el': el, 'az_enc': readings[0], 'el_enc': readings[1],
        'time': np.cumsum(rng.uniform(60.0, 150.0, n))}, {'time_is_utc': False, **meta})


def begins(run):
    """Rows with which sessions begin."""
    return (1 + np.flatnonzero(np.diff(run.get('run', np.ones(len(run)))))).tolist()


def test_sessions_begin_at_the_rows_of_the_steps():
    found = []
    for seed in range(20):
        step = 24 + 2 * seed
        run = split_at_steps(few_places(seed, {step: 8.0}, lines=np.arange(2, 98)))
        found.append(begins(run) == [step])
        (note,) = run.meta['notes']
        assert note['after'] == note['before'] + 1 == 2 + begins(run)[0]
        assert np.allclose(note['noise_arcsec'], 1.0, atol=0.35)
    assert sum(found) >= 19
    two = [split_at_steps(few_places(seed, {30: 10.0, 66: -40.0})) for seed in (1, 2)]
    assert [begins(run) for run in two] == [[30, 66]] * 2


def test_what_is_said_after_a_step_is_said_beside_its_sessions():
    found = fit_run(few_places(5, {50: 8.0}), sessions=None)
    assert begins(found.run) == [50] and (found.terms.weights > 0.0).all()
    notes = ' '.join(wording(one) for one in found.findings if not isinstance(one, str))
    assert 'between rows 49 and 50' in notes
    assert 'nothing moved between visits except the zeros of 2 sessions' in notes


@pytest.mark.parametrize('shared, ratio', [(0.0, None), (4.0, 2.2)])
def test_rows_of_one_star_that_err_alike_count_as_fewer(shared, ratio):
    rng = np.random.default_rng(4)
    run = make_run(rng, 24, noise=(shared, shared)).select(np.repeat(np.arange(24), 5))
    for name, noise in zip(('az_enc', 'el_enc'), 0.5 * ARCSEC * rng.normal(size=(2, 120))):
        run.columns[name] = run[name] + noise
    run.columns['time'] = 30.0 * np.arange(120.0) + 300.0 * np.repeat(np.arange(24), 5)
    found = [one for one in fit_run(run).findings if 'one star' in getattr(one, 'kind', '')]
    assert len(found) == bool(ratio)
    assert not ratio or found[0].size == pytest.approx(ratio, abs=0.1)


@pytest.mark.parametrize('column, step, unit', [
    ('az_enc_deg', 0.01, '36″'), ('az_enc_deg', 360.0 / 2**16, '19.8″'), ('el_deg', 1.0, None)])
def test_coarse_readings_are_named_where_rounding_is_what_remains(tmp_path, column, step, unit):
    run = make_run(np.random.default_rng(5), 50)
    table = {f'{name}_deg': run[name] / DEG for name in ('az', 'el', 'az_enc', 'el_enc')}
    moved = step * np.rint(table[column] / step) - table[column]
    table[column] = table[column] + moved
    if not unit:  # a grid of exact angles
        table['el_enc_deg'] = table['el_enc_deg'] + moved
    path = tmp_path / 'run.csv'
    path.write_text('\n'.join([','.join(table), *(
        ','.join(f'{v:.7f}' for v in row) for row in zip(*table.values()))]))
    found = [wording(one) for one in fit_run(read_run(path)).findings
             if 'coarse' in getattr(one, 'kind', '')]
    assert len(found) == bool(unit)
    assert not unit or f'{column} in steps of {unit}: rounding alone scatters' in found[0]


def test_times_cut_off_to_the_second_are_named_and_exact_ones_are_not(tmp_path):
    model, found = PointingModel({'IA': 60.0 * ARCSEC, 'AN': 20.0 * ARCSEC}), []
    rng = np.random.default_rng(6)
    time = 1.78e9 + np.cumsum(rng.uniform(60.0, 120.0, 60))
    ra, dec = rng.uniform(0.0, 360.0, (2, 60))
    dec = 20.0 + dec / 6.0
    for true in (time, np.floor(time)):
        az, el, height = axis_angles(ALTAZ, ra, dec, true, latitude_deg=48.0, longitude_deg=11.0)
        az_enc, el_enc = (v / DEG for v in model.sky_to_encoder(az * DEG, el * DEG))
        el_enc = el_enc + rng.normal(0.0, 1.0 / 3600.0, 60)
        path = tmp_path / 'run.csv'
        path.write_text('# latitude_deg: 48\n# longitude_deg: 11\n# frame: ICRS\n'
                        'time,ra_deg,dec_deg,az_enc_deg,el_enc_deg\n' + ''.join(
                            f'{t:.0f},{a:.7f},{d:.7f},{x:.7f},{y:.7f}\n'
                            for t, a, d, x, y, h in zip(np.floor(time), ra, dec, az_enc, el_enc,
                                                        height) if h > 10.0))
        found.append([wording(one) for one in fit_run(read_run(path)).findings
                      if 'coarse' in getattr(one, 'kind', '')])
    assert not found[1] and 'time in steps of 1 s' in found[0][0]


def test_where_nothing_moved_the_noise_is_told():
    found = fit_run(two_passes(size=0.0))
    (again,) = [one for one in found.findings if 'visited again' in getattr(one, 'kind', '')]
    assert np.allclose(again['noise_arcsec'], 1.0, rtol=0.4)
    assert 'nothing moved between visits' in wording(again)


def test_a_diagnosis_begins_a_session_at_a_step_and_leaves_a_small_one_to_the_search():
    found = diagnose(two_passes(), cross_validation=False, flips=199)
    assert found.verdict == 'none' and len(found.observations.runs) == 2
    assert kinds(found.notes).count('step between visits') == 1
    small = two_passes(size=5.0, places=40)
    assert 'run' in split_at_steps(small) and 'run' not in arrange(small).runs[0]
    # hours of gaps alone are asked
    assert 'run' not in arrange(two_passes(), sessions=0.0).runs[0]


def test_sessions_of_hours_have_zeros_of_their_own_in_a_fit():
    run = two_passes(size=30.0)
    run.columns['time'][20:] += 5.0 * 3600.0
    assert fit_run(run, sessions=3.0).terms.names[-2:] == ('IA[2]', 'IE[2]')
    assert fit_run(run, sessions=8.0).halves.radial > 5.0
    # a session of one row has its own zero and no row to judge it by
    run.columns['time'][39] += 5.0 * 3600.0
    assert fit_run(run, sessions=3.0).halves is None


def remembering(seed, rho, exposures=1):
    """A run of 40 rows whose errors are rho times those of the row before, and noise."""
    run, rng = make_run(np.random.default_rng([3, seed]), 40 // exposures, (0, 0)), (
        np.random.default_rng([4, seed]))
    noise = rng.normal(size=(2, len(run)))
    for i in range(1, len(run)):
        noise[:, i] = rho * noise[:, i - 1] + np.sqrt(1.0 - rho**2) * noise[:, i]
    errors = np.repeat(noise, exposures, axis=1) * ARCSEC
    run = run.select(np.repeat(np.arange(len(run)), exposures))
    return PointingRun({**run.columns, 'az_enc': run['az_enc'] + errors[0] / np.cos(run['el']),
                        'el_enc': run['el_enc'] + errors[1], 'time': 1.7e9 + 90.0 * np.arange(40)})


def memory_of(run):
    fit = fit_terms(run)
    return [one for one in memory_findings(ResidualRows.from_fit(run, fit), fit.names)
            if one.kind == 'consecutive rows alike']


def test_consecutive_rows_that_err_alike_are_told_of():
    found = [memory_of(remembering(seed, 0.95)) for seed in range(40)]
    assert sum(map(bool, found)) >= 38
    assert 0.7 < np.median([one.size for each in found for one in each]) < 0.95
    run = remembering(0, 0.95)
    (one,) = memory_of(run.select(np.random.default_rng(0).permutation(len(run))))  # by time
    assert one['terms'] == ['IA', 'IE']
    text = ('Errors of consecutive rows are correlated in azimuth and elevation (r = 0.6): the '
            'true error of IA and IE is larger than printed. telescope-mount diagnose allows '
            'for it')
    assert wording(one) == text and text in fit_document(fit_run(run))['notes']


@pytest.mark.parametrize('exposures', [1, 2])
def test_white_noise_is_no_memory_nor_are_two_exposures_of_each_star(exposures):
    assert sum(bool(memory_of(remembering(seed, 0.0, exposures))) for seed in range(150)) <= 1


def test_outliers_one_after_the_other_are_told_as_one():
    run, clean = (make_run(np.random.default_rng(4), n=80) for _ in range(2))
    run.columns['el_enc'][20:24] += 60.0 * ARCSEC
    (found,) = [one for one in fit_run(run).findings if kinds([one]) == ['outliers together']]
    assert found['rows'] == [20, 21, 22, 23] and found['axis'] == 'elevation'
    assert found['what'] == 'time' and found.size == pytest.approx(60.0, abs=5.0)
    assert 'Rows 20, 21, 22, 23 are' in wording(found)
    result = diagnose(run, cross_validation=False, flips=199)
    assert 'outliers together' in kinds(result.notes)
    assert kinds(fit_run(clean).findings).count('outliers together') == 0


@pytest.mark.parametrize('what, said', [
    ('direction', 'within 2.0° of azimuth 120°, elevation 45°'),
    ('azimuth', 'within 1.5° of azimuth 120°, at elevations from 40° to 50°'),
    ('first axis', 'at hour angle from -10.0° to 3.0°'), ('time', 'look at what was done then'),
    ('star', 'of star 11767'), ('side', 'through the pole')])
def test_where_outliers_lie_is_told(what, said):
    text = wording(Finding('outliers together', -12.0, evidence={
        'axis': 'declination', 'word': 'line', 'what': what, 'rows': [3, 4, 9], 'of': 4,
        'azimuth_deg': 120.0, 'aside_deg': 1.5, 'elevation_deg': (40.0, 50.0), 'radius_deg': 2.0,
        'first_deg': (-10.0, 3.0), 'first_axis': 'hour angle', 'star': '11767', 'chance': 0.001,
        'side': True}))
    assert said in text and 'Lines 3, 4, 9 are 12.0″ too low in declination' in text


def test_zeros_that_jump_far_are_told_without_places_visited_again():
    """Of 14 stars the seven terms take on most of it, and the fit looks merely bad."""
    for seed in range(8):
        run = night(seed, 14)
        run.columns['az_enc'][7:] += 100.0 * ARCSEC
        found, = jumps(run)
        assert (found['before'], found['after']) == (6, 7)
        assert found.size == pytest.approx(100.0, abs=9.0)
        assert found.before > 3.0 * found.after
        assert 'jumped by +' in wording(found) and 'between rows 6 and 7' in wording(found)


@pytest.mark.parametrize('noise', [
    lambda rng, el: rng.normal(size=(2, len(el))),
    lambda rng, el: np.cumsum(3.0 * rng.normal(size=(2, len(el))), axis=1),
    lambda rng, el: rng.normal(size=(2, len(el))) + np.linspace(0.0, 60.0, len(el)),
    lambda rng, el: rng.standard_t(2, size=(2, len(el)))])
def test_zeros_that_drift_or_scatter_do_not_jump(noise):
    assert not any(jumps(night(seed, n, noise=noise)) for seed in range(8) for n in (14, 40))


def jumps(run):
    fit = fit_terms(run)
    return jump_findings(ResidualRows.from_fit(run, fit), tuple(fit.model.terms))


def test_what_rounding_leaves_is_no_noise():
    """Of exact readings the last digits are alike from row to row."""
    for seed in range(20):
        run = night(seed, 40, noise=lambda rng, el: np.zeros((2, len(el))))
        fit = fit_terms(run)
        rows, terms = ResidualRows.from_fit(run, fit), tuple(fit.model.terms)
        assert memory_findings(rows, terms) == jump_findings(rows, terms) == []
