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

"""Periodic errors of gears: their columns, their words, what is declared of them."""

import numpy as np
import pytest

from calibration.analysis.finding import Finding
from calibration.report.period_wording import period_sentences
from calibration.report.wording import wording
from msg_tools.units import ARCSEC, DEG
from pointing_model.context import Context
from pointing_model.effects import Amount, declared_graduation, declared_worms, dictionary, effect
from pointing_model.effects.gears_and_worms import peak_to_peak, strain_wave
from pointing_model.fitted_effects import FittedEffect
from pointing_model.model import PointingModel
from pointing_model.mounts import Mount
from pointing_model.runs.run import PointingRun

GERMAN = Mount.equatorial(40.0 * DEG, 'german')


def run_of(n=40, **meta):
    rng = np.random.default_rng(1)
    h, d = rng.uniform(-1.0, 1.0, n), rng.uniform(-0.3, 1.0, n)
    return PointingRun({'az': h, 'el': d, 'az_enc': h + 0.01, 'el_enc': d},
                       {'mount': GERMAN, **meta})


def test_a_worm_moves_the_angle_of_its_axis_once_a_tooth():
    e = effect('periodic', axis='az', turns=180.0, orders=(1, 2), mount='german')
    context = Context.from_run(run_of())
    reading, cos = context.get('reading_az'), np.cos(context.el)
    columns = e.columns(context)
    assert np.allclose(columns[0], [np.cos(180.0 * reading) * cos, 0.0 * cos])
    assert np.allclose(columns[3], [np.sin(360.0 * reading) * cos, 0.0 * cos])
    # a tooth farther it is the same
    farther = context.at(context.az, context.el, az_enc=reading + 2.0 * DEG)
    assert np.allclose(e.columns(farther), columns)


def test_it_is_told_as_owners_of_mounts_measure_it():
    e = effect('periodic', axis='az', turns=180.0, mount='german')
    assert e.clause(Amount(np.array([3.0, 4.0]))) == (
        'The hour angle has a periodic error of 10.0″ peak to peak, 180 per turn (2°, 478.7 s at '
        'sidereal rate)')
    assert any('worm wheel of 180 teeth' in text for text in period_sentences(e))
    assert any('Otherwise each power-on has its own' in text for text in period_sentences(e))
    second = effect('periodic', axis='el', turns=200.0, mount='german')
    assert 'sidereal' not in second.clause(Amount(np.array([3.0, 4.0])))
    text = ' '.join(period_sentences(second))
    assert 'worm wheel of 200 teeth' in text and 'strain-wave drive of 100:1 (twice' in text
    assert strain_wave(100.0) == [(50, 2), (100, 1)] and not strain_wave(180.0)
    clock = effect('periodic', axis='az', turns=100.0, of='time', origin=5.0, mount='german')
    assert 'each 861.6 s' in clock.clause(Amount(np.array([3.0, 4.0])))
    assert 'periodic in time' in ' '.join(period_sentences(clock))
    assert period_sentences(effect('latency')) == []


def test_peak_to_peak_of_a_wave_with_a_harmonic():
    assert peak_to_peak([3.0, 4.0], (1,)) == pytest.approx(10.0, rel=1e-4)
    assert peak_to_peak([0.0, 1.0, 0.0, 1.0], (1, 2)) == pytest.approx(3.52, abs=0.01)


def test_a_declared_worm_is_looked_for_in_the_dictionary():
    assert declared_worms('ha=180, dec=144') == {'az': 180.0, 'el': 144.0}
    assert declared_worms({'az': 180.0}) == {'az': 180.0}
    names = {e.name for e in dictionary(Context.from_run(run_of(worms='ha=180')))[0]}
    assert 'hour_angle_periodic_error_180' in names
    assert not any('periodic' in e.name for e in dictionary(Context.from_run(run_of()))[0])
    for bad in ('ha', 'hour=180', 'ha=x', 'ha=0'):
        with pytest.raises(ValueError, match='teeth of the worm wheel'):
            declared_worms(bad)


@pytest.mark.parametrize('declare, given', [
    (declared_worms, 'az=180'), (declared_graduation, 'el.grating=47200')])
def test_an_axis_of_another_mount_is_refused(declare, given):
    with pytest.raises(ValueError, match='a German mount has no axis .* ha .hour angle. and dec'):
        declare(given, GERMAN.names)
    assert declare(given.replace('az', 'ha').replace('el', 'dec'), GERMAN.names) == declare(given)


def test_a_tape_is_declared_by_about_its_lines():
    assert declared_graduation('ha.tape=12000')['az'] == {'tape': 12000}
    names = {e.name for e in dictionary(Context.from_run(run_of(graduation='tape=12000')))[0]}
    assert not any('subdivision' in name for name in names)


def test_a_model_applies_it_at_what_will_be_read():
    found = FittedEffect(effect('periodic', axis='az', turns=180.0, mount='german'),
                         np.array([10.0, 0.0]) * ARCSEC)
    model = PointingModel({'IH': 0.5 * DEG}, effects=[found], mount=GERMAN)
    back = PointingModel.from_json(model.to_json())
    az, _ = back.sky_to_encoder(0.2, 0.3)
    assert az - 0.2 - 0.5 * DEG == pytest.approx(10.0 * ARCSEC * np.cos(180.0 * az), abs=1e-10)
    assert back.encoder_to_sky(*back.sky_to_encoder(0.2, 0.3))[0] == pytest.approx(0.2, abs=1e-10)


def test_what_is_said_of_a_period_that_was_searched():
    evidence = {'axis': 'az', 'of': 'reading', 'orders': [1], 'whole': True, 'tape': None,
                'searched': 180.02, 'strain_wave': [], 'aliases': [252.0, 540.0]}
    text = wording(Finding('period', 180.0, 0.04, evidence=evidence))
    assert text.startswith('period searched from 10 to 1000 per turn: 180.02 ± 0.04, so 180')
    assert 'Equally good: 252 and 540: the rows are nearly evenly spaced' in text
    text = wording(Finding('period', 12034.5, 0.04, evidence={
        **evidence, 'tape': 12000, 'searched': 12034.5, 'aliases': []}))
    assert 'within 1 % of 12000 a turn: 12034.5' in text
