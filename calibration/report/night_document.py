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

"""Report of the fit of a night, for JSON, with labels of the models compared in its checks."""

from msg_tools.units import ARCSEC
from pointing_model.pointing_terms import PHYSICAL
from pointing_model.zero import BY_POLARIS

from ..analysis import holdout_comparison as kinds
from ..analysis.fit_result import named
from ..analysis.harmonic_fit import READ_AS, rows_of_terms
from ..rows import counts
from .wording import wording
from .zero_wording import zero_document

FORMAT, VERSION = 'telescope_mount/calibration_report', 1
#: largest number of coefficients with correlations in the report: these grow with the square
CORRELATED = 40

RAW = 'raw'
TERMS = f'{len(PHYSICAL)} physical terms'
BOTH = f'{TERMS}, then 13 harmonics'
_EARLIER = 'model of the earlier night'
_ZERO_SET, _PUBLISHED = 'zero set on ', 'published: '
ZEROED = _ZERO_SET + BY_POLARIS
#: interpretation of E in paper 000's harmonics -> its label
HARMONICS = {reading: f'13 harmonics, {text}' for reading, text in READ_AS.items()}
_LABELS = {
    kinds.RAW: lambda of: RAW, kinds.REFERENCE: lambda of: _EARLIER,
    kinds.ZEROED: lambda of: _ZERO_SET + of, kinds.HARMONICS: HARMONICS.get,
    kinds.TERMS: lambda of: TERMS, kinds.BOTH: lambda of: BOTH,
    kinds.PUBLISHED: lambda of: _PUBLISHED + of,
}


def fit_report(rows, fitted, zeros, changes, harmonic, notes):
    """Report on the fit itself.

    Parameters
    ----------
    rows : PointingRun
        Rows that were fitted.
    fitted : FitResult
    zeros : Zeros
        Measured zeros.
    changes : list of (int, int, MeasuredZero)
        Power-ons before and after, and the change of the zero.
    harmonic : bool
        Whether harmonics are published with it.
    notes : list of str
        Notes for users are appended.

    Returns
    -------
    dict
    """
    if not harmonic:
        notes += map(wording, fitted.open_directions)
    notes += [f'row {row["row"]} left out: {row["reason"]}' for row in fitted.excluded]
    rejected = fitted.rejected_stars(rows)
    notes += map(wording, [*named(rejected), *fitted.freedom_findings])
    return {
        'format': FORMAT, 'version': VERSION, **rows.mount.entries(), **counts(rows),
        'zeros': list(map(zero_document, zeros.values())),
        'changes': [{'from': before, 'to': after, **zero_document(change)}
                    for before, after, change in changes],
        'zeros_in_force': fitted.zeros.to_list(),
        'terms': rows_of_terms(fitted.model) if harmonic else fitted.term_rows(),
        'correlations': fitted.correlations[:CORRELATED, :CORRELATED].tolist(),
        'condition': fitted.condition,
        'rejected': len(fitted.rejected),
        **({'outliers': [one.evidence for one in rejected]} if rejected else {}),
        **({'degrees_of_freedom': fitted.degrees_of_freedom} if fitted.few else {}),
        'noise_arcsec': [s / ARCSEC for s in fitted.scatter],
    }


def labelled_steps(steps):
    """Entries of `held_out.held_out_steps` with ``step``, a label, for the document."""
    return [{'step': _LABELS[one['kind']](one['of']), 'used': one['used'],
             'held_out': one['held_out']} for one in steps]


def labelled_checks(checks):
    """Entries of `external_check.power_on_check` with ``check``, a label, for the document."""
    own = ('of', 'fitted', 'tried', 'by', 'renewed')
    return [{'check': _check_label(*(one[key] for key in own)),
             **{key: value for key, value in one.items() if key not in own}} for one in checks]


def _check_label(of, fitted, tried, by, renewed):
    if fitted is None:
        way = by if by == BY_POLARIS else f'the zero by {by}'
        return f'{_EARLIER} on all stars of tonight, {"after" if renewed else "before"} {way}'
    zero = f'zero by {by}' if renewed else 'with the old zero'
    return f'{of} of power-on {fitted} on the stars of power-on {tried}, {zero}'


def steps_of(report):
    """The first step, the zero set, and the published model; None where missing.

    Returns
    -------
    tuple of (dict or None)
    """
    steps = report.get('steps') or []
    first = steps[0] if steps else None
    zeroed = next((step for step in steps if step['step'].startswith(_ZERO_SET)), None)
    last = next((step for step in reversed(steps) if step['step'].startswith(_PUBLISHED)), None) \
        or next((step for step in steps if step['step'] == TERMS), None)
    return first, zeroed, last
