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

"""The words on terms whose sign or size no mount should have."""

import numpy as np
import pytest
from documents import document

from calibration.analysis.diagnosis.diagnosis import diagnose
from calibration.analysis.diagnosis.implausible_terms import refraction_in_place, suspicious
from calibration.analysis.run_fit import implausible_values
from calibration.report.implausible_wording import implausible_caution, implausible_term
from calibration.report.verdict_wording import Statement, verdict_sentences
from calibration.report.wording import wording
from msg_tools.units import ARCSEC
from pointing_model.runs.run import PointingRun


def test_a_sign_that_the_effects_only_leave_in_doubt_is_told():
    text = implausible_term({'name': 'TF', 'value_arcsec': -60.2, 'sigma_arcsec': 3.1,
                             'what': 'sign', 'beside_effects_arcsec': -13.4,
                             'altaz': True})
    assert text.startswith(
        'TF, tube flexure, is negative (−60.2 ± 3.1″ before the effects were added; '
        '−13.4″ with them, because they have the same curve). Weight cannot lift a tube.')


def test_a_tube_that_bends_up():
    row = {'name': 'TF', 'value_arcsec': -78.1, 'sigma_arcsec': 6.3}
    text, = map(wording, implausible_values([row]))
    assert text.startswith('TF, tube flexure, is negative (−78.1 ± 6.3″)')
    assert implausible_caution({**row, 'what': 'sign'}) == (
        'TF is −78.1 ± 6.3″, of the wrong sign for a mount: check refraction, columns and signs.')
    assert 'refraction was applied twice' in text and 'Check first, at the desk' in text
    assert not implausible_values([{**row, 'value_arcsec': -12.0}, {**row, 'name': 'AW'},
                                   {**row, 'value_arcsec': 78.1}])


@pytest.mark.parametrize('gain, said', [
    (9.0, 'Most likely refraction was applied twice'), (0.0, 'explains it as well'),
    (-30.0, 'explains only a part')])
def test_what_refraction_has_to_do_with_it(gain, said):
    fitted = {'value_arcsec': -41.0, 'delta_bic': gain, 'beside_arcsec': -20.0}
    row = {'name': 'TF', 'what': 'sign', 'value_arcsec': -78.1, 'sigma_arcsec': 6.3,
           'alone_arcsec': -58.0, 'altaz': True, 'refraction': fitted}
    text = implausible_term(row)
    assert said in text and '−41.0″ of cot E' in text and '−58.0″ before the effects' in text
    assert ('disc is off centre' in text) == (gain < 6.0)
    assert 'disc' not in implausible_term({**row, 'altaz': False})
    other = {'cause': 'disc oval', 'value_arcsec': 24.3, 'sigma_arcsec': 5.5}
    text_of_both = implausible_term({**row, 'sound_with': [other]})
    assert 'With others that fit as well it is not (+24.3 ± 5.5″ with disc oval)' in text_of_both
    # among the first things, also where nothing is missing
    told = document([], unphysical=[row])
    assert verdict_sentences(told, [Statement('A.')])[1][0] == text
    told.update(verdict='none', effects=[])
    headline, sentences = verdict_sentences(told)
    assert headline.endswith('But check TF, which is negative') and sentences[0] == text


def test_sizes_that_no_mount_has():
    def named(name, value):
        return [row['what'] for row in suspicious(
            [{'name': name, 'value_arcsec': value, 'sigma_arcsec': 1.0}])]
    assert named('TX', -58.0) == named('TX', 58.0) == named('NPAE', 4000.0) == ['size']
    assert not named('TX', 8.0) and not named('CA', 900.0) and not named('AW', 4000.0)
    text, = map(wording, implausible_values(
        [{'name': 'TX', 'value_arcsec': -58.0, 'sigma_arcsec': 1.0}]))
    assert 'applied twice to the star places' in text


def test_refraction_that_was_put_in_twice_is_told_from_the_rows():
    rng = np.random.default_rng(4)
    az, el = rng.uniform(0.0, 2.0 * np.pi, 80), np.arcsin(rng.uniform(0.2, 0.98, 80))
    noise = rng.normal(size=(2, 80)) * ARCSEC

    def fitted(bend):
        run = PointingRun({'az': az, 'el': el, 'az_enc': az + noise[0] / np.cos(el),
                           'el_enc': el + bend + noise[1]})
        found = diagnose(run, flips=199, cross_validation=False)
        return found, {row['name']: row for row in found.to_dict()['unphysical']}
    found, told = fitted(-58.0 * ARCSEC / np.tan(el))
    # found as an effect, it is as large as all of the refraction
    assert list(told) == ['TX'] and 'twice' in implausible_term(told['TX'])
    twice = refraction_in_place(found)
    assert twice['delta_bic'] > 100.0 and twice['value_arcsec'] == pytest.approx(-58.0, abs=2.0)
    assert twice['beside_arcsec'] == pytest.approx(0.0, abs=5.0)
    found, told = fitted(-40.0 * ARCSEC * np.cos(el))
    assert list(told) == ['TF'] and told['TF']['refraction']['delta_bic'] < -20.0
    assert told['TF']['value_arcsec'] == pytest.approx(-40.0, abs=5.0)
    assert fitted(40.0 * ARCSEC * np.cos(el))[1] == {}
