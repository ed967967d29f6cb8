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

"""Words for a tracked night: results of each measurement, and consistency of the filter."""


def _filter_consistency(found):
    if found['tested'] is None:
        return found['verdict']
    count, ratio = found['tested']
    return (f'{found["verdict"]}: errors of {count} stars were {ratio:.2f} times the predicted '
            'ones (RMS)')


def _filter_widened(found):
    noise, walk = f'{found["noise"]:.2f} times', f'{found["walk"]:.2f} times'
    return f'{_filter_consistency(found["verdict"])}; ' + {
        'walk': f'drifts are assumed {walk} as fast from now on',
        'noise': f'the noise of stars is assumed {noise} as large from now on',
        'both': f'from now on star noise is assumed {noise} as large, drifts {walk} as fast',
        'neither': 'the assumed star noise or drift is too large',
    }[found['changed']]


KINDS = {
    'no stamp': lambda found: 'a time stamp that is not a number',
    'late measurement': lambda found: (
        f'stamp {found.size:.3f} s before the last one; late measurements are not used'),
    'no number': lambda found: 'a value that is not finite',
    'no sigma': lambda found: 'a sigma that is not finite and positive',
    'star twice': lambda found: (
        f'star {found["star"]}: measured twice with this time stamp; counted once'),
    'star out of reach': lambda found: (
        f'star {found["star"]}: the mount cannot point there by the model; check the position'),
    'unknown sensor': lambda found: (
        f'{found["sensor"]}: not a sensor of this filter; name it when you make the filter'),
    'long gap': lambda found: (
        f'nothing for {found.size:.1f} h: zeros and tilt get the uncertainty of a '
        'new night'),
    'wrong star': lambda found: (
        f'star {found["star"]} is a wrong star ({100.0 * found.size:.0f} %)'),
    'jump': lambda found: (
        f'{found.causes[0]}: jumped before star {found["star"]} ({100.0 * found.size:.0f} %)'),
    'filter consistency': _filter_consistency,
    'filter widened': _filter_widened,
    'night start': lambda found: (
        f'since the last night: {found.causes[0]} ({100.0 * found.size:.0f} %), by '
        f'{found["stars"]} stars'),
    'singular covariance': lambda found: (
        f'the covariance of the model is singular: {found.size:.1f} arcsec are added to each term'),
    'missing zeros': lambda found: (
        f'the model has no {", ".join(found.causes)}: added, unknown within {found.size:.0f} '
        'arcsec'),
}


def last_update(night):
    """Result of the last star of a `TrackedNight`, for users."""
    expected = night.document()['expected_arcsec']
    return '; '.join([
        f'{night.stars} stars tracked; expected {expected["now"]:.2f} arcsec now, '
        f'{expected["1 h"]:.2f} in an hour without a star',
        *(KINDS[found.kind](found) for update in night.updates for found in update.findings)])
