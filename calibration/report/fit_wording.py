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

"""Words for a fit: undetermined terms, errors of mount or sky, comparison with a new model."""

from datetime import datetime, timezone

from msg_tools.units import ARCSEC
from pointing_model.effects.base import arcsec, readable
from pointing_model.mounts import OF_MOUNT, ON_SKY

from .implausible_wording import implausible_term
from .row_wording import far_text

#: shown in place of a standard error
UNDETERMINED = 'undetermined'
#: label of an RMS on rows not used in the fit
VALIDATED = 'cross-validated (2 halves)'


def _undetermined(found):
    held, carrying = found['held'], found['carrying']
    text = f'undetermined by these stars: {", ".join(found["terms"])}'
    if held and carrying:
        text += (f'. {", ".join(held)} {"is" if len(held) == 1 else "are"} held at zero, and '
                 f'{", ".join(carrying)} '
                 f'{"includes" if len(carrying) == 1 else "include"} them here')
    elif held:
        text += '; held at zero'
    return text + '. The model is valid near these stars only: observe other parts of the sky'


def _times_sigmas(found):
    one, *more = [f'{ratio:.2g} times the given sigmas in {axis}'
                  for axis, ratio in found['ratios'].items()]
    return ''.join(['residuals scatter ', one, *(
        f', {ratio.replace(" times the given sigmas", "")}' for ratio in more)])


def _little_freedom(found):
    dof = found['degrees']
    return (f'{dof} degree{"s" * (dof != 1)} of freedom: use the 95 % intervals (Student\'s t); '
            'two sigmas are too narrow')


def _rejected_star(found):
    when = found['time'] and datetime.fromtimestamp(found['time'], timezone.utc)
    return (f'star {found["star"]}{f" at {when:%H:%M:%S} UTC" if when else ""} is rejected: '
            f'{far_text(found.size)} off')


def origin_sentence(origin):
    """Whether the errors of a German mount are of the mount or on the sky; a `sky_model.Origin`."""
    mount, sky = (origin.left_out[name] / ARCSEC for name in (OF_MOUNT, ON_SKY))
    figures = (f'cross-validated RMS {mount:.2f} arcsec as errors of the mount, {sky:.2f} '
               f'as errors applied on the sky (p = {origin.chance:.1g})')
    if origin.holds == ON_SKY:
        terms = ', '.join(f'{row["name"]} {row["value_arcsec"]:+.1f}'
                          for row in origin.fits[ON_SKY].term_rows())
        return (f'the errors are on the sky, the same on both sides of the pier: {figures}. A '
                f'driver corrects them there, or causes them. Terms of one sign: {terms}')
    if origin.holds == OF_MOUNT:
        return f'the errors are of the mount, on both sides of the pier: {figures}'
    return f'undetermined whether the errors are of the mount or on the sky: {figures}'


def comparison_sentence(comparison, axes=('azimuth', 'elevation')):
    """Sentence on an `estimation.comparison.PairedComparison` of two models on new rows."""
    names = {'az': f'in {axes[0]}', 'el': f'in {axes[1]}', 'radial': 'on the sky'}
    parts = []
    for axis in comparison.worse or ('radial',):
        one = getattr(comparison, axis)
        parts.append(f'{one.before:.2f} -> {one.after:.2f} arcsec {names[axis]} '
                     f'(p = {one.chance:.2g})')
    return (f'{comparison.rows} new rows: ' + ', '.join(parts)
            + '; p: probability that a harmless change looks this bad')


def _frame_taken(found):
    taken, other = found.causes
    return (f'no frame is declared: {taken} is used, because it leaves {found.before:.1f} arcsec; '
            f'the next best, {other}, leaves {found.after:.1f} arcsec')


def _first_axis_leans(found):
    terms = ', '.join(f'{name} {value:+.1f}' for name, value in found['terms_deg'].items())
    return (f'the {found["axis"]} axis would be tilted {found.size:.1f} deg ({terms}): a clock '
            'that is not UTC, or a wrong longitude or latitude, looks the same')


def _coarse_columns(found):
    steps = ', '.join(f'{one["column"]} in steps of {one["step"]:.3g}{one["unit"]}'
                      for one in found['steps'])
    return (f'{steps}: rounding alone scatters {arcsec(found.size)} RMS on the sky, and '
            f'{arcsec(found.after)} remain. Write more digits'
            + '. Times cut off move zero and tilt, too' * ('time in' in steps))


def _sigma_of_solver(found):
    low, high = found['given_arcsec']
    az, el = found['scatter_arcsec']
    return (f'solutions are weighted by their own sigma ({low:.2g} to {high:.2g} arcsec) and the '
            f'extra scatter: {az:.2g} arcsec in azimuth, {el:.2g} in elevation')


#: kind of a `Finding` -> its sentence
KINDS = {
    'undetermined terms': _undetermined,
    'raised sigma': lambda found: (
        f'{found["place"]}: sigma {found["axis"]} {found["given"] / ARCSEC:.3g}″ is far '
        f'below the others\'; taken as {found["taken"] / ARCSEC:.3g}″, a fifth of their median'),
    'sigmas multiplied': lambda found: (
        f'{_times_sigmas(found)}: the given sigmas were multiplied by this'),
    'sigmas too large': lambda found: (
        f'{_times_sigmas(found)}: errors of the terms use these, and are probably too large'),
    'few degrees of freedom': _little_freedom,
    'rows not judged': lambda found: (
        'no row could be tested as an outlier: observe more'),
    'implausible term': lambda found: implausible_term(found.evidence),
    'held model': lambda found: (
        f'held at the values of {found["file"]}, not refitted: '
        + ', '.join(map(readable, found.causes))),
    'rejected star': _rejected_star,
    'more stars rejected': lambda found: f'{found.size} more rows are rejected',
    'open direction': lambda found: f'the stars do not determine {found["direction"]}',
    'runs fitted as one': lambda found: (
        f'{found.size} runs (column run) fitted together, with one zero: select one with --run '
        'N, or fit a zero to each with --sessions auto'),
    'not cross-validated': lambda found: (
        f'{found["model"]}: not cross-validated, too few stars'),
    'better model': lambda found: (
        f'cross-validation prefers another model: {found["best"]} {found.after:.2f} arcsec radial '
        f'cross-validated, {found["model"]} {found.before:.2f}'),
    'many far places': lambda found: (
        f'{found.size} of {found["rows"]} places are far from where the encoders point: too '
        'many, so none is excluded for it'),
    'far place': lambda found: (
        f'{far_text(found.size)} from where the encoders point: wrong plate solution, or a slip'),
    'copied solution': lambda found: (
        f'solution copied from row {found["of"]}, {far_text(found.size)} from where the '
        'encoders point'),
    'rows of one star alike': lambda found: (
        f'rows of one star err alike (r = {found["r"]:.2f}), so they count as fewer: errors of the '
        f'terms are {found.size:.1f} times those printed'),
    'coarse columns': _coarse_columns,
    'frame taken': _frame_taken,
    'leaning first axis': _first_axis_leans,
    'sigma of the solver': _sigma_of_solver,
}
