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

"""Which rows of a file are a session, and what each session fits for itself."""

import numpy as np
import pytest

from calibration.analysis.diagnosis.base_terms import Base
from calibration.analysis.diagnosis.diagnosis import diagnose
from calibration.analysis.diagnosis.sessions import arrange, split_run, split_runs
from calibration.analysis.harmonic_fit import HarmonicChoice
from calibration.analysis.run_fit import fit_run
from calibration.report.diagnosis_view import view_of
from calibration.report.wording import wording
from msg_tools.units import ARCSEC, DEG
from pointing_model import geometry
from pointing_model.model import PointingModel
from pointing_model.model_application import apply
from pointing_model.pointing_terms import PHYSICAL
from pointing_model.runs.run import PointingRun

TRUTH = dict(zip(PHYSICAL, np.array([20.0, -35.0, 25.0, -18.0, 30.0, -22.0, 15.0]) * ARCSEC))


def nights(seed, counts=(30, 30, 30), gap=14.0, **moving):
    """Nights with a gap of some hours; ``IA=[0, 20, -10]``: arcsec that a term is off in each."""
    rng = np.random.default_rng(seed)
    parts = []
    for i, n in enumerate(counts):
        az = rng.uniform(0.0, 2.0 * np.pi, n)
        el = np.arcsin(rng.uniform(np.sin(20.0 * DEG), np.sin(85.0 * DEG), n))
        terms = {t: v + moving.get(t, [0.0] * len(counts))[i] * ARCSEC for t, v in TRUTH.items()}
        az_enc, el_enc = geometry.sky_to_encoder(az, el, terms)
        x, y = ARCSEC * rng.normal(size=(2, n))
        hours = i * (gap + 5.0) + np.sort(rng.uniform(0.0, 5.0, n))
        parts.append(PointingRun({'az': az, 'el': el, 'time': 1.7e9 + 3600.0 * hours,
                                  'az_enc': az_enc + x / np.cos(el), 'el_enc': el_enc + y},
                                 {'source': 'days.csv', 'notes': []}))
    return parts


def joined(*args, **moving):
    return PointingRun.concatenate(nights(*args, **moving))


def test_nights_with_zeros_of_their_own_are_sessions():
    found = arrange(joined(1, IA=[0.0, 15.0, -8.0], IE=[0.0, 3.0, -12.0]))
    assert found.own_terms == ('IA', 'IE') and found.hours == 3.0
    assert np.bincount(found.runs[0]['run']).tolist() == [0, 30, 30, 30]
    assert '3 sessions, at gaps of more than 3 h' in wording(found.runs[0].meta['notes'][0])
    result = diagnose(joined(1, IA=[0.0, 15.0, -8.0]), flips=199, cross_validation=False)
    assert result.verdict == 'none' and result.base.own == ('IA', 'IE')
    assert result.before['rms_arcsec'] < 1.6


def _numbered(run, numbers):
    return PointingRun({**run.columns, 'run': np.repeat(numbers, 30)}, run.meta)


@pytest.mark.parametrize('fit', [
    lambda run: fit_run(run, sessions=None).model,
    lambda run: fit_run(run, sessions=None, harmonics=HarmonicChoice('zenith', degree=1)).model,
    lambda run: diagnose(run, flips=199, cross_validation=False).model])
def test_a_saved_model_has_the_zero_of_each_run(fit):
    zeros = {7: (0.0, 0.0), 8: (100.0, -50.0), 9: (-70.0, 40.0)}
    az_off, el_off = map(list, zip(*zeros.values()))
    read = _numbered(joined(1, IA=az_off, IE=el_off), [7, 8, 9])
    model = PointingModel.from_json(fit(read).to_json())
    az, el = np.array([10.0, 100.0, 190.0]), np.array([25.0, 35.0, 45.0])
    for number, (first, second) in zeros.items():
        there = geometry.sky_to_encoder(az * DEG, el * DEG, {
            **TRUTH, 'IA': TRUTH['IA'] + first * ARCSEC, 'IE': TRUTH['IE'] + second * ARCSEC})
        for how in ({'zero': number}, {'run': np.full(3, number)},
                    *[{}] * (number == 9)):  # the newest by default
            off = (np.array(apply(model, az, el, **how)) * DEG - there) / ARCSEC
            assert np.abs(off).max() < 4.0
    with pytest.raises(ValueError, match='no zero of run 10; it has: 7, 8, 9'):
        apply(model, az, el, zero=10)
    with pytest.raises(ValueError, match='no zero of run 10'):
        apply(model, az, el, run=[7, 8, 10])


def test_runs_of_several_files_are_numbered_in_time():
    files = nights(1, IA=[0.0, 100.0, -70.0])
    for i, run in enumerate(files, 1):
        run.meta['source'] = f'night{i}.csv'
    found = diagnose([files[2], files[0], files[1]], flips=99, cross_validation=False)
    there = geometry.sky_to_encoder(1.0, 0.5, {**TRUTH, 'IA': TRUTH['IA'] - 70.0 * ARCSEC})
    for how in {}, {'zero': 3}, {'run': 3}:
        off = np.array(apply(found.model, 1.0 / DEG, 0.5 / DEG, **how)) * DEG - there
        assert np.abs(off).max() < 4.0 * ARCSEC
    assert any('apply uses that of the newest, run 3' in wording(note)
               for note in found.notes)
    files[0].columns['run'] = np.full(30, 7)  # numbers of its own are another's, too
    found = diagnose(files, flips=99, cross_validation=False)
    assert 'zeros_of_runs' not in found.model.provenance
    assert any('set a zero, or fit the night' in wording(note) for note in found.notes)


def test_sessions_that_are_other_runs_than_the_file_says_carry_no_zeros():
    read = joined(1, IA=[0.0, 100.0, -70.0])
    assert len(fit_run(read, sessions=None).model.provenance['zeros_of_runs']) == 3
    one = fit_run(_numbered(read, [5, 5, 5]), sessions=3.0).model
    assert 'zeros_of_runs' not in one.provenance


def test_nights_of_one_mount_stay_one_run():
    alone = [arrange(joined(seed, counts=(20, 25))) for seed in range(40)]
    assert sum(found.hours is not None for found in alone) <= 2
    one = next(found for found in alone if found.hours is None)
    assert one.own_terms == () and 'run' not in one.runs[0]
    assert one.runs[0].meta['notes'][0].kind == 'gaps without sessions'


def test_what_else_moves_is_chosen():
    leaning = {'AN': [0.0, 20.0, -15.0], 'AW': [0.0, -12.0, 18.0]}
    found = arrange(joined(2, IA=[0.0, 15.0, -8.0], **leaning))
    assert found.own_terms == ('IA', 'IE', 'AN', 'AW')
    assert ('IA', 'IE', 'AN', 'AW') in [note.causes for note in found.runs[0].meta['notes']]
    # a session moves as a file does
    files = arrange(nights(2, **leaning))
    assert files.own_terms == ('IA', 'IE', 'AN', 'AW') and files.hours is None
    assert arrange(nights(3)).own_terms == ('IA', 'IE')
    # never what the base does not have
    assert not {'AN', 'AW'} & set(arrange(joined(2, **leaning), Base.parse('index')).own_terms)


def test_the_user_has_the_last_word():
    moved = joined(1, IA=[0.0, 15.0, -8.0])
    assert arrange(moved, sessions=0.0) == ([moved], (), None)
    assert arrange(moved, own_terms=('IA',)).own_terms == ('IA',)
    forced = arrange(joined(5), sessions=10.0)
    assert forced.own_terms == ('IA', 'IE') and set(forced.runs[0]['run']) == {1, 2, 3}
    assert diagnose(moved, Base.parse('physical'), flips=99, cross_validation=False,
                    sessions=None).base.own == ()
    with pytest.raises(ValueError, match='gaps of -2 h'):
        arrange(moved, sessions=-2.0)
    moved.columns['time'][3] = np.nan
    with pytest.raises(ValueError, match=r'days\.csv: sessions need the time'):
        split_run(moved, 3.0)
    assert arrange(moved).hours is None  # nothing tells the sessions
    assert len(split_runs(nights(1), 3.0)) == 3


def test_runs_held_out_are_divided_as_the_others():
    moved = {'IA': [0.0, 15.0, -8.0], 'IE': [0.0, -10.0, 9.0]}
    result = diagnose(joined(1, **moved), holdout=joined(9, **moved), flips=199,
                      cross_validation=False)
    assert result.before['holdout_rms_arcsec'] < 1.6
    assert any('90 observations of 3 runs; only IA, IE refitted' in wording(note)
               for note in result.notes)


def _told(runs, **options):
    for i, run in enumerate(runs):
        run.meta = {**run.meta, 'source': f'night{i}.csv'}
    result = diagnose(runs, flips=199, cross_validation=False, **options)
    return result, [wording(note) for note in result.notes
                    if getattr(note, 'kind', '') == 'term of each session']


def test_a_term_that_moves_is_reported_with_its_values_and_what_it_follows():
    kelvin = [12.0, 2.0, 8.0, -3.0, 5.0]
    runs = nights(4, counts=(30,) * 5, TF=[3.0 * one for one in kelvin])
    for run, temperature in zip(runs, kelvin):
        run.columns['temperature'] = temperature - np.linspace(0.0, 1.0, len(run))
    result, (text,) = _told(runs)
    values = [terms['TF'] for terms in result.run_terms.values()]
    low, high = (f'{value:+.2f}'.replace('-', '\u2212') for value in (min(values), max(values)))
    assert f'TF differs between the 5 sessions: {low}' in text and f' to {high}' in text
    assert 'follows the temperature, +' in text and ' per °C' in text
    assert text in view_of(result).summary.cautions  # on the first layer
    # three cannot show what it goes with, one value is none that moves
    (text,) = _told(nights(4, CA=[0.0, 25.0, 50.0]))[1]
    assert text.startswith('CA differs between the 3 sessions') and 'follows' not in text
    assert _told(nights(3), own_terms=('IA', 'IE', 'CA'))[1] == []


def test_a_run_that_scatters_more_counts_by_its_own_noise():
    runs = nights(6, counts=(40, 40, 40))
    for i, (run, times) in enumerate(zip(runs, (1.0, 1.0, 6.0))):
        rng, el = np.random.default_rng(i), run['el']
        x, y = times * ARCSEC * rng.normal(size=(2, 40)) * (times > 1.0)
        run.columns['az_enc'] = run['az_enc'] + x / np.cos(el)
        run.columns['el_enc'] = run['el_enc'] + y + 8.0 * ARCSEC * np.sin(2.0 * run['az'])
        run.meta = {**run.meta, 'source': f'night{i}.csv'}
    result = diagnose(runs, flips=199, cross_validation=False)
    note, = [one for one in result.notes if getattr(one, 'kind', '') == 'noisier run']
    assert wording(note).startswith('night2.csv scatters ') and note.size == pytest.approx(6, abs=1)
    assert wording(note) in view_of(result).summary.cautions
    runs[2].columns['el_enc'][[7, 8]] += 90.0 * ARCSEC
    caution = next(one for one in view_of(diagnose(
        runs, flips=99, cross_validation=False)).summary.cautions if 'excluded' in one)
    assert 'night2.csv row 7 (' in caution and 'night2.csv row 8 (' in caution
    # six sigma of the others are one of its own; what moves all of them is found all the same
    assert (result.weights > 0.0).all()
    assert [e.fitted.effect.name for e in result.effects] == ['elevation_nod_2']
    assert not [one for one in diagnose(nights(6), flips=199, cross_validation=False).notes
                if getattr(one, 'kind', '') == 'noisier run']
