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

"""Words for causes that explain a run equally well, and for observations to separate them."""

from pointing_model.effects.base import readable


def _names(names, between):
    return between.join(map(readable, names))


def _open(found):
    best, *others = found.causes
    return f'{readable(best)}, or ' + ', '.join(
        f'{readable(name)} (ΔBIC {found["behind"][name]:.1f} worse)' for name in others)


def _alike(found):
    best, *others = found.causes
    needed = ', '.join(
        f'{readable(name)}: ' + (KINDS[one.kind](one) if one.kind == 'alike on all stars'
                                 else f'it needs {KINDS[one.kind](one)}')
        for name, one in found['needed'].items())
    return f'{readable(best)} or {_names(others, " or ")} cannot be distinguished here; {needed}'


def _star(found):
    best, nearest = map(readable, found.causes)
    return (f'to distinguish {best} from {nearest}: ΔBIC {found["behind"]:.1f}, needed '
            f'{found["told"]:g}; here they differ by {found.size:.1f} sigma per star')


def _later(found):
    night = '' if found['tonight'] else ' of the next night,'
    return f'stars{night} {found.size:g} h later'


KINDS = {
    'one cause left': lambda found: f'one cause is left: {readable(found.causes[0])}',
    'causes open': _open,
    'causes alike here': _alike,
    'sets of causes': lambda found: '; '.join(KINDS[one.kind](one) for one in found['sets']),
    'star to discriminate': _star,
    'low stars needed': lambda found: f'stars down to {found.size:g} deg of elevation',
    'magnitudes needed': lambda found: 'brighter and fainter stars',
    'later stars needed': _later,
    'warmer stars needed': lambda found: (
        f'stars {abs(found.size):g} K {"warmer" if found.size > 0.0 else "colder"}'),
    'fast target needed': lambda found: 'a fast target, such as a satellite',
    'more stars needed': lambda found: f'about {found.size} such stars',
    'alike on all stars': lambda found: 'they look the same on all stars',
}
