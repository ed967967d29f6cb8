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

"""Words for a predictive model: its parts, and its accuracy over the sky."""

import math

from pointing_model.effects.base import readable

#: names of the models that `estimation.predictor` averages
WAYS = {'terms': 'terms alone', 'choice': 'greedy choice (BIC)',
        'choice with steps': 'greedy choice with zero steps',
        'ridge': 'ridge with slow zero drift',
        'strong effects and ridge': 'strong effects, ridge and slow zero drift'}


def shares_text(shares):
    """Weights of the averaged models, largest first."""
    return ', '.join(f'{100.0 * share:.0f} % {WAYS[way]}' for way, share in sorted(
        shares.items(), key=lambda item: -item[1]) if share > 0.0)


def _prediction(found):
    low = math.exp(-found.size)
    ratio = (f'cross-validated in blocks of time the RMS is {low:.2f} ± {low * found.sigma:.2f} '
             'times that of the terms alone, outliers excluded')
    if not found['beyond']:
        return f'prediction: the terms alone are kept; with more {ratio}, not significant'
    return (f'prediction: {shares_text(found["shares"])}; {ratio}. Largest parts: '
            f'{", ".join(map(readable, found["largest"]))}. No cause is claimed; diagnose looks '
            'for causes')


def _reach(found):
    text = (f'expected error of a new star (1 sigma, radial, its own noise of '
            f'{math.hypot(found["noise_x_arcsec"], found["noise_y_arcsec"]):.2f} arcsec included): '
            f'{found["among_arcsec"]:.2f} arcsec among these stars')
    return text if found['least_arcsec'] is None else (
        f'{text}, {found["least_arcsec"]:.2f} or more in the least observed tenth of the sky '
        'above 15 degrees')


KINDS = {
    'prediction': _prediction,
    'reach of a prediction': _reach,
    'prediction by order': lambda found: (
        f'the file has no times: up to {found.size:.2f} arcsec RMS of the model follow the order '
        'of these rows, and are valid for them only'),
    'better prediction': lambda found: (
        f'for prediction alone fit --predict is better: {found.after:.2f} arcsec RMS, '
        f'cross-validated in blocks of time; this diagnosis {found.before:.2f}. It names no '
        'cause'),
}
