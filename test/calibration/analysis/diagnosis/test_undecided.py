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

"""Too few and too unequal sessions: neither an effect nor its absence."""

import numpy as np
import pytest

from calibration.analysis.diagnosis.diagnosis import diagnose
from calibration.analysis.diagnosis.validation import mark_undecided
from calibration.estimation.folds import effective_runs
from calibration.report.diagnosis_page import render
from calibration.report.diagnosis_view import view_of
from calibration.report.verdict_wording import verdict_sentences
from calibration.report.wording import paragraph
from msg_tools.units import ARCSEC, DEG
from pointing_model.runs.run import PointingRun


def sessions(seed, size, n=25):
    """Four sessions, in one of which alone the line of sight swings."""
    rng = np.random.default_rng(seed)
    session = np.repeat(np.arange(4), n)
    az = rng.uniform(0.0, 2.0 * np.pi, 4 * n)
    el = np.arcsin(rng.uniform(np.sin(20.0 * DEG), np.sin(80.0 * DEG), 4 * n))
    x, y = ARCSEC * rng.normal(size=(2, 4 * n))
    x = x + size * ARCSEC * np.sin(2.0 * az) * (session == 2)
    time = 1.7e9 + 86400.0 * session + np.tile(np.linspace(0.0, 3600.0 * 3, n), 4)
    zero = np.array([0.0, 40.0, -25.0, 60.0])[session] * ARCSEC
    return PointingRun({'az': az, 'el': el, 'time': time,
                        'az_enc': az + zero + x / np.cos(el), 'el_enc': el + y})


def test_what_the_sessions_cannot_test_is_undecided():
    result = diagnose(sessions(7, 15.0), flips=199)
    assert result.to_dict()['runs'] == 4 and result.effects == []
    assert result.verdict == 'undecided' and result.detectable is None
    headline, sentences = verdict_sentences(result.to_dict(), caution=paragraph(result.cautions))
    assert 'Undecided' in headline and 'too unequal' in sentences[0]
    page = render(view_of(result))
    assert 'nothing missing' not in page and 'class="verdict undecided"' in page
    clean = diagnose(sessions(7, 0.0), flips=199)
    assert clean.verdict == 'none' and clean.detectable


def test_a_small_effect_that_does_not_hold_is_none():
    result = diagnose(sessions(4, 0.0), flips=99, cross_validation=False)
    mark_undecided(result, ['azimuth_zero_step'], 500.0)
    assert result.verdict == 'none'  # nothing was left out, so nothing failed
    result.before['cv_rms_arcsec'] = 1.2 * result.noise_floor_arcsec
    mark_undecided(result, ['azimuth_zero_step'], 12.0)
    mark_undecided(result, [], 500.0)
    assert result.verdict == 'none' and not result.cautions
    mark_undecided(result, ['azimuth_zero_step'], 100.0)
    assert result.verdict == 'undecided' and 'azimuth_zero_step' in result.cautions[0].causes


@pytest.mark.parametrize('counts, worth', [((20, 20, 20, 20), 4.0), ((7, 1, 37, 49), 2.31)])
def test_unequal_runs_are_worth_fewer(counts, worth):
    label = np.repeat(np.arange(len(counts)), counts)
    assert effective_runs(label) == pytest.approx(worth, abs=0.01)
