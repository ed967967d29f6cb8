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

"""Words for how what is left scatters: along the elevation, and by axis."""

from pointing_model.effects.base import arcsec
from pointing_model.mount_kinds import kind_of

#: times as much one axis scatters, from where that is the headline
_HEADLINE = 3.0


def scatter_sentence(document):
    """An `unequal_scatter` of a document in words; '' without one."""
    found = document.get('unequal_scatter')
    if not found:
        return ''
    bands = found['bands']
    word = kind_of(document).axes['xy'.index(found['axis'])]
    figures = ', '.join(f'{arcsec(band["rms_arcsec"])} from {band["from_deg"]:.0f}° to '
                        f'{band["to_deg"]:.0f}°' for band in bands)
    lowest = max(bands, key=lambda band: band['rms_arcsec']) is bands[0]
    return (f'What is left in {word} is not the same at all elevations: {figures} (RMS). '
            + ('Seeing and refraction grow toward the horizon, and may be that.' if lowest else
               'Seeing grows toward the horizon only, so this is no noise of the sky: something '
               'is left there that no effect here describes.'))


def axes_words(document):
    """Which axis scatters more than the other, as a clause; '' where both do alike."""
    found = document.get('unequal_axes')
    if not found:
        return ''
    axes, more = kind_of(document).axes, 'xy'.index(found['axis'])
    sizes = [arcsec(size) for size in found['sigma_arcsec']]
    return (f'the {axes[more]} scatters {found["times"]:.1f} times as much as the '
            f'{axes[1 - more]}, {sizes[more]} against {sizes[1 - more]} on the sky')


def is_headline(document):
    """Whether the axes are so unequal that this comes first."""
    found = document.get('unequal_axes')
    return bool(found) and found['times'] >= _HEADLINE


def axes_sentence(document):
    """`axes_words` as a sentence, with what it may be."""
    found, text = document.get('unequal_axes'), axes_words(document)
    if not found:
        return ''
    kind = kind_of(document)
    chance = 'p < 0.001' if found['p'] < 0.0005 else f'p = {found["p"]:.2g}'
    out = [f'{text[:1].upper()}{text[1:]} (robust σ, {chance}).',
           'Seeing and the camera make both alike, so this is no noise of the sky.']
    letter = kind.letters[1]
    if found['axis'] == 'y':
        out.append(f'Look at drive, encoder, clutch and balance of the {kind.shafts[1]}.')
    elif found['law'] == 'cosine':
        out.append(f'It scatters as cos {letter}, as the angle of the {kind.shafts[0]} does. Look '
                   'at its drive, encoder and clutch, and at the clock.')
    elif found['law'] == 'even':
        out.append(f'It scatters evenly, not as cos {letter}: no error of the angle of the '
                   f'{kind.shafts[0]}. Look at optics, mirror and camera (rows, tilt, wind).')
    else:
        out.append(f'The data do not determine whether it scatters as cos {letter} (drive, '
                   'encoder, clock) or evenly (optics, camera).')
    return ' '.join(out)
