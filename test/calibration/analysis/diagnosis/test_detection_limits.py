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

"""What a run would have shown: the promise, kept on nights with effects of that size."""

import numpy as np
import pytest

from calibration.analysis.diagnosis.base_terms import Base
from calibration.analysis.diagnosis.detection_limits import detectable
from calibration.analysis.diagnosis.observations import observations
from calibration.analysis.diagnosis.run_problem import RunProblem
from calibration.estimation.chance import Chance
from calibration.estimation.select import search
from calibration.report.diagnosis_summary import summary_of
from calibration.report.verdict_wording import verdict_sentences
from msg_tools.units import ARCSEC, DEG
from pointing_model.runs.run import PointingRun


def clean(rng, n=60, noise=1.0, hours=2.0):
    az = rng.uniform(0.0, 2.0 * np.pi, n)
    el = np.arcsin(rng.uniform(np.sin(20.0 * DEG), np.sin(85.0 * DEG), n))
    x, y = noise * ARCSEC * rng.normal(size=(2, n))
    return PointingRun({
        'az': az, 'el': el, 'time': 1.7e9 + np.sort(rng.uniform(0.0, 3600.0 * hours, n)),
        'approach_az': rng.choice([-1.0, 1.0], n), 'approach_el': rng.choice([-1.0, 1.0], n),
        'az_enc': az + 40.0 * ARCSEC + x / np.cos(el), 'el_enc': el + y})


def of(run, rng):
    problem = RunProblem(observations(run), Base.parse('physical'), 0.01, curves=False).problem
    chance = Chance(len(run), 499, rng)
    return problem, chance, {r['name']: r for r in detectable(problem, chance, 0.01)}


def test_nine_of_ten_effects_of_that_size_are_found():
    rng = np.random.default_rng(11)
    names = ('azimuth_encoder_1', 'elevation_nod_2', 'azimuth_zero_with_time',
             'elevation_hysteresis')
    found = half = 0
    for _ in range(8):
        problem, chance, rows = of(clean(rng), rng)
        b = problem.b
        for name in names:
            group = [e.name for e in problem.dictionary.effects].index(name)
            columns = problem.dictionary.of(group)
            phase = rng.normal(size=len(columns))
            size = rows[name]['amplitude_arcsec'] * ARCSEC / (2.0 if 'hysteresis' in name else 1.0)
            signal = size * phase @ columns / np.linalg.norm(phase)
            problem.b = b + signal
            found += bool(search(problem, 0.01, chance).chosen)
            problem.b = b + 0.5 * signal
            half += bool(search(problem, 0.01, chance).chosen)
    # 29 expected of 32, 2.9 standard deviations; a night has all four, one at a time
    assert 24 <= found <= 31 and half < 16


def test_noise_and_rows_tell_the_size():
    rng = np.random.default_rng(4)
    sizes = {(n, noise): of(clean(rng, n, noise), rng)[2]['azimuth_encoder_1']['amplitude_arcsec']
             for n, noise in ((60, 1.0), (60, 3.0), (240, 1.0))}
    assert sizes[60, 3.0] / sizes[60, 1.0] == pytest.approx(3.0, rel=0.3)
    assert sizes[60, 1.0] / sizes[240, 1.0] == pytest.approx(2.0, rel=0.35)


def test_what_would_have_been_found_is_said():
    _, _, rows = of(clean(np.random.default_rng(2)), np.random.default_rng(2))
    drift = rows['elevation_zero_with_time']
    assert drift['unit'] == 'arcsec/h' and drift['rms_arcsec'] < drift['amplitude_arcsec']
    document = {'verdict': 'none', 'effects': [], 'before': {'rms_arcsec': 1.4}, 'after': {},
                'noise_floor_arcsec': 1.4, 'detectable': list(rows.values())}
    headline, sentences = verdict_sentences(document)
    assert headline == 'No significant error'
    assert sentences[2].startswith('Detection limits (90 %): ')
    assert f'drift {drift["amplitude_arcsec"]:.2f}″/h' in sentences[2]
    first = summary_of({**document, 'runs': 1}, (), ()).todo  # of terminal and page
    assert first.count(';') == 3 and sentences[2].startswith(first.removesuffix('.'))
    assert verdict_sentences({**document, 'detectable': None})[1][1].startswith('The model')
