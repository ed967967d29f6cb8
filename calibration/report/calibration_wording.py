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

"""Words for the answers and the status of the calibration."""

from msg_tools.units import ARCSEC

from ..analysis.external_check import ways
from .night_document import steps_of
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
