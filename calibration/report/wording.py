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

"""The sentence of each `Finding`, by its kind; the words are in the modules of each subject."""

from calibration.analysis.finding import Finding, is_caution

from . import (
    diagnosis_wording,
    discrimination_wording,
    encoder_wording,
    fit_wording,
    noise_wording,
    period_wording,
    prediction_wording,
    row_wording,
    satellite_wording,
    season_wording,
    track_wording,
    zero_wording,
)

KINDS = {
    'held out': lambda found: f'held out: {wording(found["of"])}',
    **fit_wording.KINDS, **row_wording.KINDS, **diagnosis_wording.KINDS,
    **track_wording.KINDS, **encoder_wording.KINDS,
    **zero_wording.KINDS, **season_wording.KINDS,
    **discrimination_wording.KINDS, **prediction_wording.KINDS,
    **period_wording.KINDS, **satellite_wording.KINDS, **noise_wording.KINDS,
}


def wording(found):
    """The sentence of a Finding; notes of the file reader are sentences already."""
    return found if isinstance(found, str) else KINDS[found.kind](found)


def worded(document):
    """A document for JSON, with findings replaced by sentences."""
    if isinstance(document, Finding):
        return wording(document)
    if isinstance(document, dict):
        return {key: worded(value) for key, value in document.items()}
    return [worded(value) for value in document] if isinstance(document, (list, tuple)) else (
        document)


def noted(notes):
    """Lines of notes: of cautions, which are printed first, and of the others."""
    return ([f'caution: {wording(note)}' for note in notes if is_caution(note)],
            [f'note: {wording(note)}' for note in notes if not is_caution(note)])


def paragraph(findings):
    """The sentences of several findings, joined."""
    return ' '.join(map(wording, findings))
