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

"""Words for answers, status and diagnostics of the calibration."""

from calibration.analysis.external_check import ways
from calibration.analysis.tracking.innovations import HONEST
from msg_tools.units import ARCSEC

from .encoder_wording import MARKS_UNKNOWN
from .night_document import steps_of
from .wording import wording
from .zero_wording import zero_statement


def zero_sentence(run, zero, few=False):
    """Sentence on a MeasuredZero set in power-on `run`; `few`: from too few exposures."""
    first, second = zero.mount.names.axes
    return (f'zero of power-on {run} by {zero.by}: {first} {zero.az / ARCSEC:+.2f} +- '
            f'{zero.sigma_az / ARCSEC:.2f} arcsec, {second} {zero.el / ARCSEC:+.2f} +- '
            f'{zero.sigma_el / ARCSEC:.2f} arcsec, relative to {zero.reference}'
            + (f'; {zero.n - zero.rejected} exposures only' if few else ''))


def zero_values(run, zero):
    """The same as a dict, for the status."""
    return {
        'power_on': run, 'by': zero.by, 'exposures': zero.n, 'rejected': zero.rejected,
        'azimuth_arcsec': f'{zero.az / ARCSEC:.3f}',
        'elevation_arcsec': f'{zero.el / ARCSEC:.3f}',
        'sigma_azimuth_arcsec': f'{zero.sigma_az / ARCSEC:.3f}',
        'sigma_elevation_arcsec': f'{zero.sigma_el / ARCSEC:.3f}',
        'contains': zero_statement(zero)}


def fit_sentence(report):
    """Sentence on a fit, from its report, or why it is not published."""
    if 'refused' in report:
        return report['refused']
    step = steps_of(report)[-1]
    return (f'{report["stars"]} stars fitted; ' + (
        f'{step["step"]}: {step["held_out"]["radial"]:.2f} arcsec radial on held-out stars'
        if step else 'too few to validate the fit')
        + (f'; {report["rejected"]} rejected' if report['rejected'] else ''))


def finding_sentence(document):
    """The verdict of a diagnosis, and the effects added to the model."""
    applied = ', '.join(document['applied'])
    return f'{document["verdict"]}: {applied}' if applied else document['verdict']


def headline(found):
    """Headline of a `NightDiagnosis`."""
    from .effect_wording import effect_summaries
    from .verdict_wording import verdict_sentences
    return verdict_sentences(found.document, effect_summaries(found.diagnosis))[0]


def refusal_sentences(document):
    """Why effects of a diagnosis are not in the model; '' if all are."""
    return '; '.join(f'not published: {entry["why"]}' for entry in document['refused'])


def rows_sentence(taken, zeros):
    """Data restored after a restart during a night: `taken` rows, and the zeros from them."""
    return (f'{taken.kept} observations, zeros by {ways(zeros.values()) or "Polaris"} of power-ons '
            + (', '.join(map(str, sorted(zeros))) or 'none'))


def restart_sentence(taken_up, model):
    """State of a restarted calibration: `taken_up` (list of str), and `model` or None."""
    known = 'no model is known until the next fit' if model is None else 'the active model'
    return f'restarted during the night: restored {", ".join(taken_up)}; {known}'


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
