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

"""Documents of diagnoses, made by hand, for tests of what is said of them."""

import numpy as np

from calibration.analysis.diagnosis.effect_causes import diagnosed_effect
from calibration.estimation.significance import Significance
from pointing_model.effects import effect
from pointing_model.fitted_effects import FittedEffect


def causes_of(effects, gains):
    """As a diagnosis has them, the first one chosen and the others in its set."""
    fitted = FittedEffect(effects[0], np.zeros(len(effects[0].coefficient_names)))
    significance = Significance(0.001, gains[0], list(range(1, len(effects))), [], np.array(gains))
    return diagnosed_effect(fitted, significance, None, effects, 0).causes


def document(causes, **more):
    rms = {'rms_arcsec': 5.4, 'cv_rms_arcsec': 5.67}
    return {'verdict': 'ambiguous', 'before': rms, 'after': {'rms_arcsec': 3.7,
            'cv_rms_arcsec': 4.3}, 'base_terms': ['IA'] * 7, 'as_read_rms_arcsec': 134.72,
            'effects': [{'name': 'elevation_encoder_2', 'causes': causes}], **more}


CAUSES = causes_of([effect('encoder', axis='el', order=2), effect('terms', name='second_flexure')],
                   [20.0, 20.1])


def contended(**more):
    """An effect of a document with one cause, and what was often chosen in its place."""
    own, other = causes_of([effect('encoder', axis='az', order=2, mount='equatorial'),
                            effect('line_of_sight', order=2, mount='equatorial')], [94.0, 49.0])
    return {'name': 'hour_angle_encoder_2', 'causes': [own], 'removes_rms_arcsec': 4.6,
            'contenders': [{**other, 'behind': 45.0, 'alone': 111.0, 'found_alone': 110.0,
                            'instead': 50, 'folds': 150, 'open': True, **more}]}
