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

import json

import numpy as np
import pytest

from calibration.analysis.harmonic_fit import HarmonicChoice
from calibration.calibration_state import CalibrationState
from calibration.report.night_document import BOTH, FORMAT, HARMONICS, RAW, TERMS, ZEROED
from msg_tools.units import ARCSEC, DEG
from pointing_model.model import PointingModel
from pointing_model.pointing_terms import PHYSICAL
from pointing_model.rms import rms_arcsec
from pointing_model.runs.run import PointingRun
from pointing_model.sky.star_catalogue import POLARIS_HIP
from pointing_model.zero import Zeros

LATITUDE = 34.3 * DEG
MOUNT = PointingModel(dict(zip(
    PHYSICAL, np.array([310, -170, 46, -23, 37, -21, 15]) * ARCSEC)),
    provenance={'source': 'last night'})
DRIFT = np.array([20.0, -12.0]) * ARCSEC  # of the second power-on, coordinate angles


def rows(az, el, run, stars, rng, zero=(0.0, 0.0), noise=0.5, mount=MOUNT):
    """Observations through `mount`; the encoder reads `zero` too much."""
    az_enc, el_enc = mount.sky_to_encoder(az, el)
    x, y = rng.normal(size=(2, len(az))) * noise * ARCSEC
    return PointingRun({
        'az': az, 'el': el, 'az_enc': az_enc + zero[0] + x / np.cos(el),
        'el_enc': el_enc + zero[1] + y, 'star': np.asarray(stars, float),
        'run': np.full(len(az), float(run))})


def field(rng, n):
    return rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(0.35, 0.99, n))


def polaris(n):
    hour = 0.3 + 0.01 * np.arange(n)
    return (0.65 * DEG * np.sin(hour) / np.cos(LATITUDE), LATITUDE + 0.65 * DEG * np.cos(hour))


def night(n=20, second=True, noise=0.5, first_zero=(0.0, 0.0)):
    """Blocks of a night, in order: stars, Polaris, then a power-on with another zero."""
    rng = np.random.default_rng(4)
    zero = np.array(first_zero)
    blocks = [rows(*field(rng, n), 1, 1000 + np.arange(n), rng, zero, noise),
              rows(*polaris(8), 1, [POLARIS_HIP] * 8, rng, zero, noise)]
    if second:
        blocks += [rows(*polaris(8), 2, [POLARIS_HIP] * 8, rng, zero + DRIFT, noise),
                   rows(*field(rng, n), 2, 2000 + np.arange(n), rng, zero + DRIFT, noise)]
    return blocks


def session(blocks, zeros=True, **options):
    out = CalibrationState(**options)
    for number, block in enumerate(blocks):
        out.add(block, (number + 1) * 10**9)
    if zeros:
        out.calibrate_zero()
    return out


def test_nothing_observed_is_said():
    empty = CalibrationState()
    assert empty.rows.taken.kept == 0
    for work in (empty.observations, empty.calibrate_zero, empty.fit):
        with pytest.raises(ValueError, match='no observation has come yet'):
            work()


def test_rows_come_back_in_order_with_the_newest_stamp():
    blocks = night()
    collected = session(blocks, zeros=False)
    assert collected.rows.taken.kept == sum(map(len, blocks)) == len(collected.observations())
    assert collected.last_stamp == 4 * 10**9
    np.testing.assert_array_equal(collected.observations()['az'],
                                  np.concatenate([b['az'] for b in blocks]))


@pytest.mark.parametrize('name', ['star', 'run'])
def test_rows_without_star_or_power_on_are_refused(name):
    block = night()[0]
    columns = {k: v for k, v in block.columns.items() if k != name}
    collected = CalibrationState()
    with pytest.raises(ValueError, match=f'observation without column {name}'):
        collected.add(PointingRun(columns), 1)
    assert collected.rows.taken.kept == 0


def test_a_zero_needs_polaris_in_the_newest_power_on():
    blocks = night()
    with pytest.raises(ValueError, match='since power-on 1, nor stars for its zero; point at'):
        session(blocks[:1])
    collected = session(blocks[:2])
    assert set(collected.zeros) == {1}
    collected.add(blocks[3], 10**10)
    with pytest.raises(ValueError, match='since power-on 2'):
        collected.calibrate_zero()


def test_an_encoder_that_reads_20_too_much_has_a_zero_of_plus_20():
    collected = session(night(second=False, first_zero=np.array([20.0, -7.0]) * ARCSEC, noise=0.01),
                        reference=MOUNT)
    zero = collected.zeros[1]
    assert zero.az / ARCSEC == pytest.approx(20.0, abs=0.1)
    assert zero.el / ARCSEC == pytest.approx(-7.0, abs=0.1)
    assert 'last night' in zero.reference


def test_without_a_reference_the_change_shows_between_power_ons():
    collected = session(night())
    run, zero = collected.calibrate_zero()
    assert run == 2 and zero is collected.zeros[2]
    assert abs(zero.az) > 100 * ARCSEC  # all that the mount does at Polaris
    _, report = collected.fit()
    change, = report['changes']
    assert (change['from'], change['to']) == (1, 2)
    for axis, wanted in zip(('az', 'el'), DRIFT / ARCSEC):
        assert change[f'{axis}_arcsec'] == pytest.approx(
            wanted, abs=4 * change[f'sigma_{axis}_arcsec'])
        assert change[f'sigma_{axis}_arcsec'] < 1.0


def test_the_fit_finds_the_mount_and_predicts_stars_that_it_did_not_see():
    model, report = session(night(n=60)).fit()
    found = {term['name']: term for term in report['terms']}
    assert list(found)[:len(PHYSICAL)] == list(PHYSICAL)
    for name in ('CA', 'NPAE', 'AN', 'AW', 'TF'):  # IA and IE are in the zero
        assert found[name]['value_arcsec'] == pytest.approx(
            MOUNT.terms[name] / ARCSEC, abs=4 * found[name]['sigma_arcsec'])
    steps = {step['step']: step for step in report['steps']}
    assert list(steps) == [RAW, ZEROED, *HARMONICS.values(), TERMS, BOTH]
    assert steps[RAW]['held_out']['radial'] > steps[ZEROED]['held_out']['radial'] > 10
    assert 0.4 < steps[TERMS]['held_out']['radial'] < 1.2  # the noise: 0.7
    assert steps[TERMS]['used']['n'] + steps[TERMS]['held_out']['n'] == 120
    # on this mount the harmonics have nothing to find, and alone they cannot do it
    assert steps[BOTH]['held_out']['radial'] < 2.0
    assert steps['13 harmonics, E read as zenith distance']['held_out']['radial'] > 2.0
    assert report['stars'] == 120 and report['polaris'] == 16
    assert report['notes'] == []
    assert model.provenance['last_stamp_ns'] == 4 * 10**9


def test_the_check_between_power_ons_improves_with_the_zero_by_polaris():
    checks = session(night(n=60)).fit()[1]['external_check']
    assert [row['check'] for row in checks] == [
        'model of power-on 1 on the stars of power-on 2, with the old zero',
        'model of power-on 1 on the stars of power-on 2, zero by Polaris']
    assert checks[0]['radial'] > 10 > 2 > checks[1]['radial']
    assert checks[0]['n'] == checks[1]['n'] == 60


def test_a_reference_night_is_judged_before_and_after_polaris():
    drift = np.array([25.0, 14.0]) * ARCSEC
    _, report = session(night(n=60, second=False, first_zero=drift), reference=MOUNT).fit()
    assert report['steps'][0]['step'] == 'model of the earlier night'
    before, after = report['external_check']
    assert before['check'].endswith('before Polaris') and before['radial'] > 15
    assert after['check'].endswith('after Polaris') and after['radial'] < 1.5
    assert report['changes'] == []


def test_stars_alone_give_the_zero_of_a_power_on_without_polaris():
    rng = np.random.default_rng(8)
    collected = session(night(n=60, second=False))
    collected.add(rows(*field(rng, 60), 2, np.arange(60), rng, zero=DRIFT), 10**10)
    model, report = collected.fit()
    assert report['stars'] == 120
    first, second = (collected.active_zeros[number].angles for number in (1, 2))
    np.testing.assert_allclose((second - first) / ARCSEC, DRIFT / ARCSEC, atol=1.0)
    assert [z['run'] for z in report['zeros_in_force']] == [1, 2]


@pytest.mark.parametrize('n', [1, 3, 12])
def test_a_zero_that_few_stars_tell_says_how_well(n):
    """A power-on that begins before the fit: its zero has not the sigma of the one before."""
    off, told, expected, before = [], [], [], None
    for seed in range(12):
        rng = np.random.default_rng(seed)
        collected = session(night(n=40, second=False))
        before = before or collected.fit()[1]['expected']
        collected.add(rows(*field(rng, n), 2, np.arange(n), rng, zero=DRIFT), 10**10)
        _, report = collected.fit()
        zero = collected.zero_of_model()
        assert zero.run == 2 and 2 not in collected.zeros
        moved = zero.angles - collected.active_zeros[1].angles
        off.append((moved - DRIFT) / zero.sigma)
        told.append(zero.sigma / ARCSEC)
        expected.append(report['expected']['rms_arcsec'])
        assert report['expected']['high_arcsec'] > report['expected']['rms_arcsec']
    off, told = np.array(off), np.mean(told, axis=0)
    assert 0.5 < np.sqrt(np.mean(np.square(off))) < 1.5 and np.abs(off).max() < 4.0
    assert told[1] == pytest.approx(0.5 / np.sqrt(n), rel=0.35)  # of the noise
    assert (np.mean(expected) > 1.2 * before['rms_arcsec']) == (n < 3)


def test_a_zero_by_its_own_exposures_is_as_well_known_as_they_say():
    collected = session(night(n=60))
    collected.fit()
    zero, measured = collected.zero_of_model(), collected.zeros[2]
    np.testing.assert_array_equal(zero.covariance, measured.with_fitted_terms)
    assert zero.by == measured.by
    np.testing.assert_array_equal(zero.angles, collected.active_zeros[2].angles)


def test_without_any_zero_all_stars_are_fitted_as_they_are():
    model, report = session(night(n=60, second=False)[:1], zeros=False).fit()
    assert report['zeros'] == [] and report['external_check'] == []
    assert [step['step'] for step in report['steps']] == [RAW, *HARMONICS.values(), TERMS, BOTH]
    assert model.terms['IE'] / ARCSEC == pytest.approx(-170, abs=3)


def test_too_few_stars_for_harmonics_that_nobody_asked_for_are_no_news():
    _, report = session(night(n=8)).fit()
    assert not any('harmonics' in note for note in report['notes'])
    assert [step['step'] for step in report['steps']] == [RAW, ZEROED, TERMS]
    assert report['steps'][-1]['held_out']['n'] == 8


def test_too_few_stars_for_anything_say_how_many():
    with pytest.raises(ValueError, match='observe'):
        session(night(n=2)[:1], zeros=False).fit()


def test_the_same_rows_give_the_same_bits():
    texts = []
    for pieces in (1, 5):
        collected = CalibrationState(split_seed=3)
        stamp = 0
        for block in night():
            for part in np.array_split(np.arange(len(block)), pieces):
                stamp += 10**9
                collected.add(block.select(part), stamp)
        collected.rows.last_stamp = 10**11
        collected.calibrate_zero()
        model, report = collected.fit()
        texts.append((model.to_json(), json.dumps(report)))
    assert texts[0] == texts[1]
    assert json.loads(texts[0][1])['format'] == FORMAT


def test_the_seed_decides_who_is_held_out():
    reports = [session(night(), split_seed=seed).fit()[1]['steps'] for seed in (1, 1, 2)]
    assert reports[0] == reports[1] != reports[2]


def test_the_model_is_for_pointing_with_the_zero():
    blocks = night(n=60, noise=0.01)
    collected = session(blocks)
    model, _ = collected.fit()
    assert model.harmonics is None
    for number, block in ((1, blocks[0]), (2, blocks[3])):
        az, el = model.sky_to_encoder(block['az'], block['el'])
        zero = collected.active_zeros[number]
        np.testing.assert_allclose(az + zero.az, block['az_enc'], atol=0.5 * ARCSEC)
        np.testing.assert_allclose(el + zero.el, block['el_enc'], atol=0.1 * ARCSEC)


def test_a_table_brings_back_the_night_after_a_restart():
    blocks = night()
    whole = PointingRun.concatenate(blocks)
    collected = CalibrationState()
    collected.add_table(whole, 4 * 10**9)
    assert collected.rows.taken.kept == len(whole)
    # what was in it already is not counted twice, and an older table takes nothing away
    collected.add(blocks[3], 4 * 10**9)
    collected.add_table(blocks[0], 10**9)
    assert collected.rows.taken.kept == len(whole)


def many_power_ons(count):
    """Stars and Polaris of each, with another zero."""
    rng, out = np.random.default_rng(8), []
    for run in range(1, count + 1):
        zero = rng.normal(size=2) * 20.0 * ARCSEC
        out += [rows(*polaris(8), run, [POLARIS_HIP] * 8, rng, zero),
                rows(*field(rng, 12), run, 1000 * run + np.arange(12), rng, zero)]
    return out


def test_of_power_ons_long_over_nothing_is_left():
    """The numbers are those of the rows that are kept, as if the others had never been."""
    blocks = many_power_ons(7)
    kept, fresh = CalibrationState(power_ons=3), session(blocks[8:])
    for number, block in enumerate(blocks):
        kept.add(block, (number - 7) * 10**9 if number >= 8 else number + 1)
        if number % 2:
            kept.calibrate_zero()
            model, report = kept.fit()
    assert kept.rows.taken == (60, 3, 80, 6 * 10**9)
    assert fresh.rows.taken.kept == 60
    assert sorted(kept.zeros) == [5, 6, 7]
    own_model, own = fresh.fit()
    for name in ('terms', 'zeros', 'zeros_in_force', 'changes', 'steps', 'external_check'):
        assert report[name] == own[name], name
    assert model.terms == own_model.terms
    told = [note for note in report['notes'] if 'last 3 power-ons' in note]
    assert len(told) == 1 and not any('kept_power_ons' in note for note in own['notes'])


def test_a_table_with_more_power_ons_than_are_kept_is_taken_once():
    blocks = many_power_ons(5)
    whole, late = PointingRun.concatenate(blocks), CalibrationState(power_ons=2)
    late.add_table(whole, 10 * 10**9)
    assert late.rows.taken.kept == 40 and late.rows.newest == 5
    known = late.observations()
    late.add_table(whole, 10 * 10**9)
    assert late.rows.taken.kept == 40
    assert late.observations()['star'].tolist() == known['star'].tolist()


@pytest.mark.parametrize('power_ons', [0, 2])
def test_rows_that_were_lost_come_with_the_table(power_ons):
    """Whether they are the last ones, or of a new power-on with fewer rows than the one that goes,
    or some in between.
    """
    blocks, whole = many_power_ons(3), CalibrationState(power_ons=power_ons)
    blocks[5] = blocks[5].select(slice(0, 6))
    for number, block in enumerate(blocks, 1):
        whole.add(block, number)
    whole.calibrate_zero()
    kept = PointingRun.concatenate(blocks[2:] if power_ons else blocks)
    for heard in (range(6), range(5), range(4), (0, 1, 2, 4, 5), (0, 1, 3, 5), ()):
        late = CalibrationState(power_ons=power_ons)
        for number in heard:
            late.add(blocks[number], number + 1)
        count = sum(map(len, blocks if power_ons == 0 else blocks[2:])) - sum(
            len(blocks[n]) for n in heard if not power_ons or n >= 2)
        assert late.add_table(kept, 6) == count
        assert late.add_table(kept, 6) == 0
        np.testing.assert_array_equal(late.observations()['az_enc'], kept['az_enc'])
        assert late.rows.newest == 3 and late.rows.taken.newest == 6
        late.calibrate_zero()
        assert late.fit()[0].terms == whole.fit()[0].terms
        assert late.zeros.keys() == whole.zeros.keys()


def test_a_table_of_an_observer_that_keeps_less_takes_nothing_away():
    blocks = many_power_ons(3)
    collected = session(blocks[:5])
    assert collected.add_table(PointingRun.concatenate(blocks[4:]), 6 * 10**9) == 12
    assert collected.rows.taken.kept == 60 and sorted(collected.zeros) == [1, 2, 3]
    # nor one that has lost its rows
    assert collected.add_table(blocks[5].select(slice(5, 9)), 8 * 10**9) == 0
    # nor one that is refused
    with pytest.raises(ValueError, match='without column star'):
        collected.add_table(PointingRun({k: v for k, v in PointingRun.concatenate(
            [*blocks, blocks[5]]).columns.items() if k != 'star'}), 9 * 10**9)
    assert collected.rows.taken.kept == 60 and collected.last_stamp == 6 * 10**9


def test_a_column_is_there_as_soon_as_all_rows_that_are_kept_have_it():
    blocks = many_power_ons(4)
    for block in blocks[3:]:
        block.columns['lean_north'] = np.full(len(block), 2.0)
    collected, there = CalibrationState(power_ons=2), []
    for number, block in enumerate(blocks, 1):
        collected.add(block, number)
        there.append('lean_north' in collected.observations())
    assert there == [False] * 6 + [True] * 2  # power-on 2 has it in a part of its rows alone
    assert (collected.observations()['lean_north'] == 2.0).all()
    # rows that come again may have what they had not
    late = CalibrationState(power_ons=2)
    told = PointingRun({**blocks[2].columns, 'lean_north': np.full(len(blocks[2]), 2.0)})
    for stamp, block in enumerate((*blocks[:2], blocks[2].select(slice(2, None)), blocks[3]), 1):
        late.add(block, stamp)
    assert late.add_table(PointingRun.concatenate([told, blocks[3]]), 4) == 2
    assert late.rows.taken.kept == 40 and 'lean_north' not in late.observations()
    late.add(blocks[4], 5)
    assert (late.observations()['lean_north'] == 2.0).all()


def test_a_run_that_somebody_holds_stays_as_it_is_when_rows_go():
    blocks, collected = many_power_ons(3), CalibrationState(power_ons=2)
    for number, block in enumerate(blocks[:4], 1):
        collected.add(block, number)
    held = collected.observations()
    before = held['run'].copy()
    collected.add(blocks[4], 5)
    assert collected.rows.taken.forgotten == 20
    np.testing.assert_array_equal(held['run'], before)


def test_blind_stars_after_a_diagnosis_are_known_as_such_when_rows_before_it_go():
    blocks = many_power_ons(3)
    for block, blind in zip(blocks, (0, 0, 0, 5, 0, 12)):
        block.columns['check'] = (np.arange(len(block)) < blind).astype(float)
    collected = session(blocks[:4], power_ons=2)
    collected.fit()
    collected.diagnose()
    for number, block in enumerate(blocks[4:], 5):
        collected.add(block, number * 10**9)
    assert set(collected.observations()['run']) == {2.0, 3.0}
    # the 5 that were there before are no judges
    assert collected.check_on_blind_stars().document['judged']['rows'] == 12


def test_a_zero_after_the_fit_goes_with_the_active_model():
    rng = np.random.default_rng(6)
    collected = session(night(second=False), zeros=False)
    model, _ = collected.fit()  # with all of IA in it
    collected.add(rows(*polaris(8), 2, [POLARIS_HIP] * 8, rng, DRIFT), 9 * 10**9)
    number, zero = collected.calibrate_zero()
    assert number == 2
    az, el = np.array([2.0]), np.array([0.9])
    wanted = np.ravel(MOUNT.sky_to_encoder(az, el)) + DRIFT
    got = np.ravel(model.sky_to_encoder(az, el)) + zero.angles
    assert np.abs(got - wanted).max() < 3 * ARCSEC
    # by Polaris alone, as fits begin with it, it holds the whole offset there
    assert abs(collected.zeros[2].az - zero.az) > 250 * ARCSEC


@pytest.mark.parametrize('alone', [False, True])
def test_harmonics_are_published_with_their_zeros(alone):
    choice = HarmonicChoice('printed', alone, 2)
    model, report = session(night(n=40), harmonics=choice).fit()
    assert list(model.terms) == ([] if alone else list(PHYSICAL))
    assert (model.harmonics.interpretation, model.harmonics.degree) == ('printed', 2)
    told = report['harmonics']
    assert {row['name']: row['value_arcsec'] for row in told['coefficients']} == pytest.approx(
        {name: value / ARCSEC for name, (value, _) in model.harmonics.coefficients.items()})
    assert [term['name'] for term in report['terms']] == list(model.terms)
    assert report['steps'][-1]['step'] == 'published: ' + told['label']
    assert any(row['check'].startswith('harmonics of power-on 1') for row in
               report['external_check'])
    rows = PointingRun.concatenate(night(n=40))
    zeros = Zeros.from_list(model.provenance['zeros_in_force'])
    left = rms_arcsec(*model.residuals(rows, zero=zeros)).radial
    if alone:  # a tilt is in no harmonics of degree 2
        assert 2.0 < told['cross_validation']['choices'][0]['radial'] * 3 < left < 12.0
    else:
        assert left < 1.0  # the noise is 0.7
    json.dumps(report, allow_nan=False)


def test_without_harmonics_nothing_is_said_of_them():
    _, report = session(night()).fit()
    assert 'harmonics' not in report
    assert not any('published' in step['step'] for step in report['steps'])


def test_too_few_stars_for_the_degree_that_was_asked_for():
    with pytest.raises(ValueError, match='harmonics of degree 4: .* or take a lower degree'):
        session(night(n=4, second=False), harmonics=HarmonicChoice('zenith', True, 4)).fit()


def test_who_cannot_be_predicted_by_harmonics_alone_is_counted():
    _, report = session(night(n=40), harmonics=HarmonicChoice('zenith', True, 4)).fit()
    assert report['expected'] is None  # of the others alone it would be too good
    assert any('outliers to the harmonics, and not to the terms' in n for n in report['notes'])


def test_after_a_restart_the_mount_is_that_of_the_active_model():
    from pointing_model.mounts import Mount
    session = CalibrationState()
    assert session.mount.names.keys == ('azimuth', 'elevation')
    session.take_up(PointingModel({'IH': 0.1}, mount=Mount.equatorial(0.6, 'german')))
    assert session.mount.names.keys == ('hour_angle', 'declination')
