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

"""How what is left scatters: along the elevation, and in one axis more than in the other."""

from types import SimpleNamespace

import numpy as np
import pytest

from calibration.analysis.diagnosis.scatter import unequal_axes, unequal_scatter
from calibration.estimation.robust import scale_law, scale_ratio
from calibration.report.noise_wording import axes_sentence, is_headline, scatter_sentence
from calibration.report.verdict_wording import verdict_sentences
from msg_tools.units import ARCSEC


def scattered(seed, more=1.0, n=120):
    """As `unequal_scatter` takes it: elevation scatters `more` times as much in the middle."""
    rng = np.random.default_rng(seed)
    el = rng.uniform(0.2, 1.4, n)
    left = ARCSEC * rng.normal(size=(2, n))
    left[1] *= np.where((el > 0.5) & (el < 0.9), more, 1.0)
    return SimpleNamespace(weights=np.ones(n), residual_after=left, observations=SimpleNamespace(
        context=SimpleNamespace(on_horizon=lambda: (el, el))))


def test_scatter_that_is_not_the_same_at_all_elevations_is_told():
    found = unequal_scatter(scattered(1, 4.0))
    assert found['axis'] == 'y' and found['p'] < 1e-3
    sizes = [band['rms_arcsec'] for band in found['bands']]
    assert sizes[1] > 1.3 * max(sizes[0], sizes[2])
    text = scatter_sentence({'unequal_scatter': found})
    assert text.startswith('Residuals in elevation change with elevation: ')
    assert 'so this is not sky noise' in text
    found['bands'][0]['rms_arcsec'] = 9.0
    assert 'can cause this' in scatter_sentence({'unequal_scatter': found})
    assert scatter_sentence({}) == ''
    assert sum(unequal_scatter(scattered(seed)) is not None for seed in range(100)) <= 1
    assert unequal_scatter(scattered(1, 4.0, n=20)) is None


def axes(times, law, n=80, seed=3):
    """Input of `unequal_axes`: left and right scatters more, by a law."""
    rng = np.random.default_rng(seed)
    el = rng.uniform(-0.5, 1.3, n)
    left = ARCSEC * rng.normal(size=(2, n))
    left[0] *= times * (np.cos(el) if law == 'cosine' else 1.0)
    context = SimpleNamespace(el=el, get=lambda name: np.arange(float(n)))
    return left, np.ones(n), context


@pytest.mark.parametrize('law, word', [('cosine', 'at the clock'), ('even', 'optics')])
def test_unequal_axes_are_told_with_the_law_of_their_scatter(law, word):
    found = unequal_axes(*axes(5.0, law))
    assert found['axis'] == 'x' and found['p'] < 1e-3 and found['law'] == law
    document = {'unequal_axes': found, 'mount': 'german'}
    text = axes_sentence(document)
    assert is_headline(document) and word in text
    assert text.startswith('The hour angle scatters ')
    assert all(len(part.split()) < 26 for part in text.split('. '))


def test_a_run_of_unequal_axes_is_never_noise():
    found = unequal_axes(*axes(2.6, 'even', n=300))
    document = {'verdict': 'none', 'unequal_axes': found, 'mount': 'german', 'effects': [],
                'before': {'rms_arcsec': 3.0}, 'after': {}, 'noise_floor_arcsec': 3.0,
                'base_terms': ['IH']}
    headline, sentences = verdict_sentences(document)
    assert headline.startswith('No significant error') and not is_headline(document)
    assert 'noise (' not in ' '.join(sentences) and 'looks like noise' not in ' '.join(sentences)
    assert any('times as much as the declination' in text for text in sentences)
    document['unequal_axes']['times'] = 3.1
    assert verdict_sentences(document)[0].startswith('The hour angle scatters 3.1 times as much')


def test_the_other_axis_is_told_by_its_name():
    one = axes(1.0, 'even')
    one[0][1] *= 4.0
    found = unequal_axes(*one)
    assert found['axis'] == 'y' and found['law'] is None
    assert 'declination axis' in axes_sentence({'unequal_axes': found, 'mount': 'german'})
    one[1][15:] = 0.0
    assert unequal_axes(*one) is None


def test_equal_axes_are_not_told_even_where_rows_remember():
    rng, told = np.random.default_rng(4), 0
    for _ in range(300):
        left = rng.normal(size=(2, 40))
        for i in range(1, 40):
            left[:, i] = 0.6 * left[:, i - 1] + 0.8 * left[:, i]
        ratio, p = scale_ratio(*left)
        told += p < 1e-3 and not 0.5 < ratio < 2.0
    assert told <= 2
    ratio, p = scale_ratio(3.0 * left[0], left[1])
    assert ratio > 1.5 and p < 0.05


def test_the_law_of_a_scatter_is_not_told_by_few_rows():
    rng = np.random.default_rng(5)
    factor = np.cos(rng.uniform(0.3, 1.4, (500, 60)))
    even = np.array([scale_law(rng.normal(size=60), of) for of in factor])
    scaled = np.array([scale_law(rng.normal(size=60) * of, of) for of in factor])
    limit = np.log(30.0)
    assert (even > limit).mean() < 0.01 > (scaled < -limit).mean()
    assert (even < -limit).mean() > 0.5 < (scaled > limit).mean()
