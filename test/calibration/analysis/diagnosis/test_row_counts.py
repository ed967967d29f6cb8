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

"""How many rows were used, and which were not, is told."""

import json

import numpy as np
import pytest

from calibration.analysis.diagnosis.diagnosis import diagnose
from calibration.analysis.diagnosis.row_counts import (
    diagnosis_row_counts,
    fit_row_counts,
    reader_row_counts,
)
from calibration.analysis.term_fit import fit_terms
from calibration.report.diagnosis_page import render
from calibration.report.diagnosis_view import view_of
from calibration.report.row_wording import used_sentence
from calibration.report.verdict_wording import verdict_sentences
from calibration.report.wording import paragraph
from msg_tools.units import ARCSEC, DEG
from pointing_model.geometry import sky_to_encoder
from pointing_model.runs.run import PointingRun

FAST = {'flips': 199, 'cross_validation': False}


def night(seed=1, n=60, backlash=0.0, **meta):
    rng = np.random.default_rng(seed)
    az, el = rng.uniform(0.0, 2.0 * np.pi, n), np.arcsin(rng.uniform(0.35, 0.99, n))
    az_enc, el_enc = sky_to_encoder(az, el, {'IA': 80 * ARCSEC, 'CA': 20 * ARCSEC,
                                             'AN': -30 * ARCSEC})
    side = rng.choice([-1.0, 1.0], n)
    x, y = rng.normal(size=(2, n)) * ARCSEC
    return PointingRun({'az': az, 'el': el, 'az_enc': az_enc + x / np.cos(el)
                        + backlash * ARCSEC * side, 'el_enc': el_enc + y,
                        'approach_az': side}, {'lines': np.arange(n) + 2, **meta})


def test_one_outlier_is_named_and_not_in_the_headline():
    run = night(source='night.csv')
    run.columns['el_enc'][29] += 0.5 * DEG
    result = diagnose(run, **FAST)
    document = json.loads(json.dumps(result.to_dict()))
    assert (document['rows_read'], document['rows_used']) == (60, 59)
    (outlier,) = document['outliers']
    assert outlier['row'] == 31 and outlier['y_arcsec'] == pytest.approx(1800.0, abs=5.0)
    assert document['before']['rms_arcsec'] < 1.7
    assert document['rms_with_outliers_arcsec'] == pytest.approx(1800.0 / np.sqrt(60), rel=0.01)
    _, sentences = verdict_sentences(document)
    assert '1 outlier excluded: line 31 (1800 arcsec off). RMS 1.' in sentences[-1]
    assert 'with it 232.' in sentences[-1]
    page = render(view_of(result))
    assert document['columns_alike'] and document['columns_alike'][0] in page
    assert '59 of 60 rows used' in page
    assert '1 outlier excluded: line 31 (1800 arcsec off)' in page


def test_outliers_of_several_files_have_their_file():
    runs = [night(1, source='a/one.csv'), night(2, source='a/two.csv')]
    runs[1].columns['az_enc'][3] += 0.47 * DEG
    document = diagnose(runs, **FAST).to_dict()
    assert [(e['source'], e['row']) for e in document['outliers']] == [('two.csv', 5)]
    assert any('two.csv line 5 (' in s for s in verdict_sentences(document)[1])


def test_above_a_third_left_out_no_effect_is_claimed():
    run = night(n=90, backlash=10.0)
    assert diagnose(run, **FAST).verdict == 'identified'
    run.columns['el_enc'][:30] = np.nan
    assert diagnose(run, **FAST).verdict == 'identified'
    run.columns['el_enc'][30] = np.nan
    result = diagnose(run, **FAST)
    assert result.verdict == 'refused' and result.effects == []
    assert result.model == result.base_model and result.before == result.after
    headline, sentences = verdict_sentences(result.to_dict(), caution=paragraph(result.cautions))
    assert 'Nothing is concluded' in headline
    assert sentences[0].startswith('59 of 90 rows are usable')
    assert 'no effect is claimed' in sentences[0]
    assert 'nothing concluded' in render(view_of(result))
    # outliers count as well
    run = night(n=90)
    run.columns['el_enc'][:31] += np.random.default_rng(1).uniform(-9.0, 9.0, 31) * DEG
    assert diagnose(run, **FAST).verdict == 'refused'


def test_rows_taken_back_in_the_file_were_never_offered():
    lost = [{'row': 90, 'reason': 'commented out'},
            {'row': 91, 'reason': 'rejected by the observers (#)'},
            {'row': 92, 'reason': 'elevation outside -5..90.1 deg'}]
    told = diagnosis_row_counts(diagnose(night(excluded=lost), **FAST))
    assert (told.read, told.used, told.lost) == (61, 60, 1) and not told.too_few
    assert used_sentence(told.to_dict()) == (
        '60 of 61 rows used; 2 more are commented out or rejected in the file')
    # a file joined to itself has every row twice
    copies = [{'row': i, 'reason': f'the same as line {i - 60}'} for i in range(62, 122)]
    told = reader_row_counts(night(excluded=copies))
    assert (told.read, told.used) == (120, 60) and not told.too_few


def test_rows_of_a_fit():
    run = night()
    run.columns['az_enc'][10] += 3.0 * DEG
    run.columns['el'][20] = np.nan
    told = fit_row_counts(run, fit_terms(run))
    assert (told.read, told.used) == (60, 58)
    assert [e['row'] for e in told.outliers] == [12] and told.rms_with > 100.0
