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

"""Values of the calibration on ``/diagnostics``: its state and problems."""

from calibration.analysis.tracking.innovations import HONEST

from ..analysis.external_check import ways
from .encoder_wording import MARKS_UNKNOWN
from .wording import wording


def state_rows(state, taken_up, finding):
    """Values of a calibration on ``/diagnostics``, pairs of name and value.

    Parameters
    ----------
    state : CalibrationState or NightSeries
    taken_up : list of str
        Data restored at a restart.
    finding : str
        Result of the last diagnosis.

    Returns
    -------
    list of (str, str)
    """
    asked = state.requests.document
    return [('observations', str(state.rows.taken.kept)),
            ('power-ons with a zero', str(len(state.zeros))),
            ('zeros by', ways(state.zeros.values()) or 'nothing yet'),
            ('taken up', '; '.join(taken_up) or 'nothing: up since the start'),
            ('diagnosis', finding or 'none yet'),
            *([('causes distinguished', asked['says'])] if asked else []),
            *(_tracking_rows(state.tracked) if state.tracks else [])]


def _tracking_rows(night):
    """Values of a `TrackedNight` or None."""
    if night is None:
        return [('tracking', 'not begun')]
    document = night.document()
    expected, start = document['expected_arcsec'], document.get('opening')
    return [('tracking', f'{document["stars"]} stars'),
            *([('since the nights before', max(start['chances'], key=start['chances'].get))]
              if start else []),
            ('expected error now, in 1 h [arcsec]',
             f'{expected["now"]:.2f}, {expected["1 h"]:.2f}'),
            ('innovations', wording(document['confidence_sentence']))]


def problem_sentences(state, marks_unknown, refused):
    """Problems: encoders and sky of the last night disagree, or cannot be compared.

    Parameters
    ----------
    state : CalibrationState or NightSeries
    marks_unknown : bool
    refused : str
        Sentences on effects of the diagnosis that are not in the model.

    Returns
    -------
    list of str
    """
    found = [state.contradiction and str(state.contradiction), *state.alarms,
             marks_unknown and MARKS_UNKNOWN, refused,
             *(tracking_problems(state.tracked) if state.tracks else [])]
    return [text for text in found if text]


def tracking_problems(night):
    """Sentences on inconsistent predictions of the filter of a `TrackedNight` (or None)."""
    if night is None:
        return ['tracking needs a model: call fit, or set model_file']
    document = night.document()
    return [] if document['confidence'] == HONEST else [
        f'tracking: the filter was {wording(document["confidence_sentence"])}; its sigma is '
        'adjusted']
