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

"""Parameters of the calibration node."""

from msg_tools.node import Param
from msg_tools.units import DEG
from pointing_model.effects import declared_graduation
from pointing_model.harmonics import DEGREE
from pointing_model.runs.run import KEPT_POWER_ONS
from pointing_model.sky.skyline import parse_horizon

from .analysis.harmonic_fit import CHOICES
from .analysis.term_fit import RCOND_HARMONICS
from .analysis.tracking import BATCH, TRACK
from .estimation.false_alarms import ALPHA


def site_of(text):
    """Latitude and longitude in rad from two numbers in degrees, or None for an empty text."""
    if not text.strip():
        return None
    try:
        latitude, longitude = (float(part) for part in text.split(','))
    except ValueError:
        raise ValueError('write latitude and longitude in degrees, "34.3, 109.0"') from None
    if not (-90.0 <= latitude <= 90.0 and -360.0 <= longitude <= 360.0):
        raise ValueError('a latitude of -90 to 90 and a longitude of -360 to 360 degrees')
    return {'latitude': latitude * DEG, 'longitude': longitude * DEG}


PARAMS = (
    Param('mode', BATCH, 'batch: fit on request; track: also update the model after each star, '
          'from the reference or the first fit on', choices=(BATCH, TRACK),
          fixed=True),
    Param('model_file', '', 'pointing model of an earlier night (JSON or YAML), the reference of '
          'the zero', fixed=True),
    Param('split_seed', 1, 'seed of the choice of held-out stars', 0, 2**31 - 1,
          fixed=True),
    Param('least_exposures', 16, 'a zero of fewer exposures comes with a warning',
          1, 100000),
    Param('reference_age', 0, 'the reference of a zero is the model fitted this many power-ons '
          'before; 0: model_file for all', 0, 1000, fixed=True),
    KEPT_POWER_ONS,
    Param('alpha', ALPHA, 'false-alarm probability: that diagnose adds an effect to a clean night',
          1e-6, 0.5),
    Param('site', '', 'latitude and longitude of the mount [deg], such as "34.3, 109.0", for '
          'what follows the stars; empty: unknown', check=site_of),
    Param('horizon', '', 'skyline corners as of the mount guard (set both under /**: '
          'in the parameter file); nothing below it is proposed; empty: unknown [deg]',
          check=parse_horizon, fixed=True),
    Param('diagnosed_at', 0, 'the service diagnose uses observations up to this stamp '
          '[ns]; 0: all. For replays, which have all at once', 0, 2**63 - 1, fixed=True),
    Param('graduation', '', 'lines per turn of the encoder, such as grating=47200, to correct '
          'slips by whole lines; empty: unknown', fixed=True, check=declared_graduation),
    Param('harmonics', 'none', "paper 000's harmonics in the model that is published, by how their "
          'E is read: zenith distance, or as printed', choices=CHOICES, fixed=True),
    Param('harmonics_alone', False, 'the harmonics without the physical terms, as in the paper; '
          'else fitted to the residuals of the terms', fixed=True),
    Param('harmonics_degree', 0, 'degree of the harmonics; 0: the best cross-validated',
          0, DEGREE, fixed=True),
    Param('harmonics_rcond', RCOND_HARMONICS, 'smallest relative singular value of the harmonics '
          'that is fitted; worse determined combinations are dropped; 1e-12: none', 1e-12, 0.1,
          fixed=True),
    Param('diagnosis_page', '', 'HTML file that the service diagnose writes; empty: none'),
)
