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

"""The words on what the raw errors consist of."""

import numpy as np
import pytest
from documents import CAUSES, document

from calibration.analysis.diagnosis.diagnosis import diagnose
from calibration.report.raw_error_wording import raw_error_sentence
from calibration.report.verdict_wording import Statement, verdict_sentences
from msg_tools.units import ARCSEC
from pointing_model.mount_kinds import KINDS
from pointing_model.runs.run import PointingRun


@pytest.mark.parametrize('kind, values, said', [
    ('german', [-1059, 30, 5, 2, 3, -256, 60], 'The raw error is mostly IH −1059″ (zero of the '
     'hour angle). The polar axis points 4.3′ too low (ME) and 3″ west of the pole (MA).'),
    ('altaz', [-60, 30, 5, 2, -24, 19, 600], 'The raw error is mostly TF +600″ (tube flexure). '
     'The azimuth axis tilts 24″ to the south (AN) and 19″ to the west (AW).'),
    ('free', [900, 30, 5, 2, 3, 4, 5], 'The raw error is mostly I1 +900″ (zero of the first '
     'axis).')])
def test_what_the_errors_as_read_consist_of(kind, values, said):
    rows = [{'name': name, 'value_arcsec': float(v), 'rms_arcsec': 0.8 * abs(v)}
            for name, v in zip(KINDS[kind].physical, values)]
    told = document(CAUSES, mount=kind, as_read_rms_arcsec=850.0, as_read_terms=sorted(
        rows, key=lambda row: -row['rms_arcsec']))
    assert raw_error_sentence({**told, 'effects': []}) == said
    said += ' Values from the fit of the 7 terms alone.'
    assert raw_error_sentence(told) == said
    assert raw_error_sentence({**told, 'as_read_rms_arcsec': 9.0}) == ''
    _, sentences = verdict_sentences(told, [Statement('A.')])
    assert sentences[2].endswith(f'; cross-validated. {said}')
    if kind == 'german':  # the other pole
        assert 'too high (ME) and 3″ east' in raw_error_sentence({**told, 'south': True})


def test_what_is_read_beyond_the_zeros_and_what_effects_move():
    values = {'IH': -7295.0, 'ID': -7192.0, 'CH': 1284.0, 'NP': 65.0, 'MA': -245.0, 'ME': 594.0,
              'TF': 122.0}
    rows = [{'name': name, 'value_arcsec': v, 'rms_arcsec': 0.8 * abs(v)}
            for name, v in values.items()]
    told = document(CAUSES, mount='german', as_read_rms_arcsec=9384.0, as_read_terms=rows)
    text = raw_error_sentence(told)
    assert 'and ID −7192″ (zero of the declination). Beyond the zeros: CH +1284″ ' \
        '(collimation, the cone error; 1027″ RMS on the sky) and ME +594″ (the tilt of the polar ' \
        'axis; 475″ RMS on the sky). The polar axis' in text
    assert text.endswith('Values from the fit of the 7 terms alone.')
    rows[2].update(beside_effects_arcsec=1046.0, resembles='declination_axis_flexure',
                   correlation=-0.97)
    rows[5].update(beside_effects_arcsec=620.0, resembles='declination_axis_flexure',
                   correlation=0.2)
    assert raw_error_sentence(told).endswith(
        'With the effect the terms change: CH from +1284″ to +1046″ (correlated with declination '
        'axis flexure, r = −0.97). ME from +594″ to +620″.')
    rows[2]['rms_arcsec'] = 150.0  # no more than a part of the lean
    assert 'Beyond the zeros' not in raw_error_sentence(told)
    # rows come by their size on the sky: what is larger there is said first
    rows[2]['rms_arcsec'] = 400.0
    told['as_read_terms'] = sorted(rows, key=lambda row: -row['rms_arcsec'])
    text = raw_error_sentence(told)
    assert 0 < text.index('ME +594″ (the tilt') < text.index('CH +1284″ (collimation')


def test_terms_that_an_effect_moves_are_told_with_it():
    rng = np.random.default_rng(2)
    n = 60
    az, el = rng.uniform(0.0, 6.28, n), rng.uniform(0.4, 1.4, n)
    bend = 60.0 * ARCSEC * np.sin(2.0 * el)
    x, y = ARCSEC * rng.normal(size=(2, n))
    run = PointingRun({'az': az, 'el': el, 'az_enc': az + x / np.cos(el),
                       'el_enc': el + y + bend}, {})
    found = diagnose(run, flips=199, cross_validation=False)
    rows = {row['name']: row for row in found.to_dict()['as_read_terms']}
    assert found.effects and rows['TF']['beside_effects_arcsec'] == pytest.approx(
        found.model.terms['TF'] / ARCSEC)
    assert rows['TF']['resembles'] == found.effects[0].fitted.effect.name
    assert 0.5 < abs(rows['TF']['correlation']) <= 1.0
    assert 'beside_effects_arcsec' not in rows['IA']


def test_where_the_axis_points_hangs_on_an_equinox_that_is_a_guess():
    values = zip(KINDS['german'].physical, [-7290, -7200, 1280, 60, -245, 594, 120])
    rows = [{'name': name, 'value_arcsec': float(v), 'rms_arcsec': abs(v)} for name, v in values]
    found = {'taken': 'J2000', 'other': 'of date', 'told': False, 'polar_axis_arcsec': {
        'J2000': {'ME': 594.0, 'MA': -245.0}, 'of date': {'ME': 108.0, 'MA': -84.0}}}
    told = document(CAUSES, mount='german', as_read_rms_arcsec=9400.0, as_read_terms=rows,
                    equinox=found)
    said = raw_error_sentence(told)
    assert (
        'The polar axis points 9.9′ too high (ME) and 4.1′ east of the pole (MA), if the catalogue '
        'of the file is J2000 (undetermined). If it is of date, it points 1.8′ too '
        'high (ME) and 84″ east of the pole (MA). Say which with --equinox before the axis is '
        'moved.') in said
    assert said in ' '.join(verdict_sentences(told, [Statement('A.')])[1])
    for settled in (None, {**found, 'told': True}):
        assert 'catalogue' not in raw_error_sentence({**told, 'equinox': settled})
    few = raw_error_sentence({**told, 'equinox': {**found, 'polar_axis_arcsec': {}}})
    assert '(undetermined). Say which' in few
