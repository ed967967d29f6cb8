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

"""A worm that nobody declared: found in a run, told in words, taken off by the model."""

import numpy as np
import pytest

from calibration.analysis.diagnosis.diagnosis import diagnose
from calibration.analysis.diagnosis.period_scans import ABSENT, FAST, NOTHING
from calibration.report.diagnosis_view import view_of
from calibration.report.documents import run_diagnosis_document
from calibration.report.verdict_wording import short_headline
from calibration.report.wording import wording
from msg_tools.units import ARCSEC, DEG
from pointing_model import geometry
from pointing_model.context import Context
from pointing_model.mounts import Mount
from pointing_model.runs.run import PointingRun

MOUNT = Mount.equatorial(40.0 * DEG, 'german')
TERMS = {'IH': 100 * ARCSEC, 'ID': -60 * ARCSEC, 'CH': 40 * ARCSEC, 'ME': -45 * ARCSEC}


def plate_solves(seed=1, n=60, lines=180.0, size=10.7, noise=1.6, phase=1.0, **meta):
    """A run with a wave of the hour angle; arcsec."""
    rng = np.random.default_rng(seed)
    sky = rng.uniform(0.0, 2.0 * np.pi, n), np.arcsin(rng.uniform(0.4, 0.98, n))
    h, d = MOUNT.axes_of(*sky, MOUNT.axes_of(*sky)[0] < 0.0)  # half of them through the pole
    az, el = geometry.sky_to_encoder(h, d, TERMS, MOUNT)
    x, y = rng.normal(0.0, noise, (2, n)) * ARCSEC
    az = az + size * ARCSEC * np.cos(lines * az + phase) + x / np.cos(d)
    return PointingRun({'az': h, 'el': d, 'az_enc': az, 'el_enc': el + y,
                        'time': 1.7e9 + 90.0 * np.arange(n)}, {'mount': MOUNT, **meta})


@pytest.fixture(scope='module')
def found():
    return diagnose(plate_solves(), cross_validation=False, flips=999, seed=1)


def test_a_worm_of_unknown_period_is_found_with_its_size(found):
    one, = found.effects
    e = one.fitted.effect
    assert e.name == 'hour_angle_periodic_error_180' and found.verdict == 'identified'
    assert np.hypot(*one.fitted.coefficients) / ARCSEC == pytest.approx(10.7, abs=1.2)
    told, = (note for note in found.notes if getattr(note, 'kind', '') == 'period')
    assert told['whole'] and told.sigma < 0.2
    assert found.unequal_axes is None


def test_it_is_told_in_the_words_of_owners(found):
    found.after.setdefault('cv_spread', None)
    view = view_of(found, run_diagnosis_document(found))
    text = repr(view)
    assert 'peak to peak, 180 per turn (2°, 478.7 s at sidereal rate)' in text
    assert 'A worm wheel of 180 teeth may have this period.' in text
    assert 'Otherwise each power-on has its own' in text
    assert 'hour angle periodic error, 180 per turn' in text.lower()


def test_the_model_takes_it_off_a_run_of_the_same_power_on(found):
    fresh = plate_solves(seed=9)
    with_it, without = (np.std(model.residuals(fresh)[0]) / ARCSEC
                        for model in (found.model, found.base_model))
    assert with_it < 2.2 < 5.0 < without


@pytest.mark.usefixtures('short_diagnosis')
def test_declared_teeth_are_a_candidate_like_others():
    result = diagnose(plate_solves(size=2.4, worms='ha=180'), cross_validation=False, seed=1)
    assert [e.fitted.effect.name for e in result.effects] == ['hour_angle_periodic_error_180']
    assert not [note for note in result.notes if getattr(note, 'kind', '') == 'period']


def test_lines_of_a_tape_are_sought_about_the_declared_ones():
    run = plate_solves(n=60, lines=12034.0, size=4.0, graduation='ha.tape=12000')
    result = diagnose(run, cross_validation=False, flips=999, seed=1)
    assert [e.fitted.effect.name for e in result.effects] == ['hour_angle_tape_12034']
    parameters = result.effects[0].fitted.effect.parameters
    assert parameters['turns'] == pytest.approx(12034.0, abs=0.4) and parameters['tape'] == 12000


def said_of_gears(run):
    """Of each kind the Finding of what another gear may be."""
    result = diagnose(run, cross_validation=False, flips=999, seed=1)
    kinds = ABSENT, FAST, NOTHING
    return {one.kind: one for one in result.notes if getattr(one, 'kind', '') in kinds}


def in_hour_angle(h, teeth, worms='', size=12.0, seed=1):
    """A run of an equatorial mount at such hour angles, with a wave of so many periods a turn."""
    rng, mount = np.random.default_rng(seed), Mount.equatorial(48.0 * DEG, 'equatorial')
    d = rng.uniform(-10.0, 75.0, len(h)) * DEG
    x, y = rng.normal(0.0, ARCSEC, (2, len(h)))
    reading = h + size * ARCSEC * np.cos(teeth * h + 0.7) + x / np.cos(d)
    return PointingRun({'az': h, 'el': d, 'az_enc': reading, 'el_enc': d + y},
                       {'mount': mount, 'worms': worms})


def test_at_even_steps_a_slow_wave_may_be_a_worm():
    """Of 180 teeth at steps of 2.02 degrees: 1.8 waves a turn."""
    h = (2.02 * np.arange(60.0) - 60.0) * DEG
    one = said_of_gears(in_hour_angle(h, 180.0))[FAST]
    assert one.size == pytest.approx(2.02, abs=0.005) and 180 in one['teeth']
    assert 'as well: the stars stand at even steps of 2.02°. Observe at uneven' in wording(one)
    # what is slow and seen at random hour angles is slow
    h = np.random.default_rng(1).uniform(-60.0, 60.0, 60) * DEG
    assert not said_of_gears(in_hour_angle(h, 2.0))


def test_declared_teeth_that_the_wave_has_not_are_said():
    h = np.random.default_rng(1).uniform(-70.0, 70.0, 70) * DEG
    twice = said_of_gears(in_hour_angle(h, 180.0, 'ha=90'))[ABSENT]
    assert twice.size < 1.0 and wording(twice).endswith('″). 180 teeth are more likely')
    wrong = said_of_gears(in_hour_angle(h, 180.0, 'ha=171'))[NOTHING]
    assert wrong['turns'] == pytest.approx([180.0], abs=0.2)
    assert wording(wrong).startswith('Nothing was found at the declared 171 per turn of hour angle')
    assert not said_of_gears(in_hour_angle(h, 180.0, 'ha=180'))


def test_periods_that_fit_as_well_at_even_steps_leave_the_cause_open():
    """Hour angles within 0.02 of a grid of 5 degrees: 36 teeth, 108 or 180."""
    rng = np.random.default_rng(3)
    h = (5.0 * rng.integers(-12, 13, 90) + rng.uniform(-0.02, 0.02, 90)) * DEG
    result = diagnose(in_hour_angle(h, 180.0), cross_validation=False, flips=999, seed=1)
    one, = result.effects
    names = {one.fitted.effect.name, *one.alternatives}
    assert result.verdict == 'ambiguous' and 'hour_angle_periodic_error_180' in names
    assert len(names) > 2
    assert len(one.causes) == len(names) and one.to_dict()['alternatives']
    said, = (note for note in result.notes if getattr(note, 'kind', '') == FAST)
    assert said['sizes'][1] > said['sizes'][0] + 1.0
    assert 'or gear of the hour angle with about 108 or 180 ' in wording(said)
    assert 'the size depends on the number, ' in wording(said)


def power_ons(*phases, **meta):
    """Runs of one worm, of which each has its own phase."""
    return [plate_solves(seed, 40, phase=phase, **meta) for seed, phase in enumerate(phases)]


PER_RUN = 'hour_angle_periodic_error_180_per_run'


@pytest.mark.usefixtures('short_diagnosis')
def test_declared_teeth_may_have_another_phase_in_each_run():
    result = diagnose(power_ons(0.2, 2.0, 4.1, worms='ha=180'), cross_validation=False, seed=1)
    one, = result.effects
    assert one.fitted.effect.name == PER_RUN
    sizes = np.hypot(*one.fitted.coefficients.reshape(-1, 2).T) / ARCSEC
    assert sizes == pytest.approx([10.7] * 3, abs=1.5)
    # of a run that it does not know it says nothing
    assert not np.any(one.fitted.effect.columns(Context.from_run(plate_solves())))
    same = diagnose(power_ons(1.0, 1.0, worms='ha=180'), cross_validation=False, seed=1)
    assert [e.fitted.effect.name for e in same.effects] == [PER_RUN.removesuffix('_per_run')]


def test_a_worm_that_one_run_shows_alone_is_offered_to_all():
    """Of four power-ons: with whole runs left out it had no gain."""
    result = diagnose(power_ons(0.2, 2.0, 4.1, 5.5), flips=999, folds=4, seed=1)
    assert [e.fitted.effect.name for e in result.effects] == [PER_RUN]
    assert result.verdict == 'identified' and not result.cautions


def test_what_single_runs_show_is_no_unexplained_scatter():
    found = {'axis': 'x', 'times': 4.3, 'sigma_arcsec': [7.88, 1.84], 'runs_alone': [
        {'run': f'night/{name}.csv', 'effect': 'hour_angle_encoder_1', 'delta_bic': 90.0}
        for name in 'ab']}
    document = {'mount': 'german', 'verdict': 'none', 'unequal_axes': found}
    assert short_headline(document, ()).endswith(
        'No effect common to all runs explains that, but alone a.csv, b.csv show hour angle '
        'encoder, 1 per turn.')
    del found['runs_alone']
    assert short_headline(document, ()).endswith('. No effect explains that.')
