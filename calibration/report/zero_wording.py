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

"""Words for zeros: covariates that explain their changes, and what a measured zero depends on."""

from calibration.analysis.zero.power_on_zeros import NO_MODEL, MeasuredZero
from pointing_model.zero import BY_POLARIS

#: names of `analysis.zero.zero_causes.COVARIATES`
COVARIATES = {
    'temperature': 'temperature',
    'supply': 'supply voltage',
    'hours': 'time since the last power-on',
    'side': 'side from which the mark was met',
}


def _words(names, between=' and '):
    return between.join(COVARIATES[name] for name in names)


def _unknown(found):
    of = '' if found.size is None else f' of {found.size} of {found["nights"]} nights'
    return f'{_words(found.causes)}: not known{of}'


def _few(found):
    lost = found['incomplete']
    lost = f', {lost} more without a covariate' if lost else ''
    return (f'{found.size} power-ons with a zero{lost}: too few to name a cause; at least '
            f'{found["needed"]} are needed')


def _causes(found):
    if found['not_tried']:
        return 'no cause can be looked for: ' + '.\n'.join(
            KINDS[one.kind](one) for one in found['not_tried'])
    return '; '.join(f'{name}: {KINDS[one.kind](one)}' for name, one in found['axes'].items())


def _follows(found):
    slopes = ', '.join(f'{one["slope_arcsec"]:+.2f} ± {one["sigma_arcsec"]:.2f}"/{one["unit"]}'
                       for one in found['slopes'])
    return (f'the zero changes with the {_words(found.causes)} ({slopes}; p = {found["p"]:.3f} '
            f'over all covariates and both axes); {found.after:.1f}" of {found.size:.1f}" remain')


KINDS = {
    'covariate unknown': _unknown,
    'covariate constant': lambda found: (
        f'{_words(found.causes)}: constant ({found.size:.2g} {found.unit} rms over the nights)'),
    'odd power-on': lambda found: (
        f'power-on {found["run"]} is excluded: its zero of {found["axis"]} is {found.size:+.0f}" '
        f'from that of the others, {found["times"]:.0f} times their error. Check what was wrong '
        'then'),
    'few power-ons': _few,
    'causes of zeros': _causes,
    'zero follows': _follows,
    'covariates alike': lambda found: (
        f'undecided: {_words(found.causes, " or ")} explain the zero equally well, because they '
        'changed together; nights on which they differ will decide'),
    'common trend': lambda found: (
        f'undecided: the zero correlates with the {_words(found.causes)} over the season, not from '
        'night to night. A random walk or drift looks the same'),
    'zero follows nothing': lambda found: 'no cause found for changes of the zero',
}


def zero_statement(zero):
    """What a `MeasuredZero` depends on: terms that its exposures cannot separate from it."""
    def list_of(axis):
        parts = sorted(zero.contamination[axis].items(), key=lambda item: -abs(item[1]))
        return ', '.join(f'{name} {v:+.2f}\u2033' for name, v in parts if abs(v) >= 0.005)
    first, second = zero.mount.names.axes
    by = '' if zero.by == BY_POLARIS else f'by {zero.by}: '
    wide = '' if zero.misfit == 1.0 else (
        f'; the stars disagree {zero.misfit:.1f} times more than their noise and the held terms '
        'allow (a term has changed): sigma is increased by this factor')
    if zero.reference == NO_MODEL and not (list_of('az') or list_of('el')):
        return (f'{by}no reference model: the stars themselves separate the zero '
                f'from the other terms, within its sigma{wide}')
    each = f'{first} by {list_of("az")}; {second} by {list_of("el")}{wide}'
    if zero.reference == NO_MODEL:
        return (f'{by}no reference model, so the zero includes the other terms. '
                f'1\u2033 of a term shifts it: {each}')
    return (f'{by}the zero is valid while the other terms stay as in its reference '
            f'({zero.reference}). A change of 1\u2033 in a term shifts it: {each}')


def zero_document(zero):
    """`to_dict` of a zero, with ``statement`` if it was measured."""
    words = {'statement': zero_statement(zero)} if isinstance(zero, MeasuredZero) else {}
    return {**zero.to_dict(), **words}
