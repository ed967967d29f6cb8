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

"""The camera that measures the star's miss distance."""

import numpy as np

from msg_tools.units import ARCSEC, wrap
from pointing_model.context import UNKNOWN
from pointing_model.mount_kinds import KINDS, USUAL
from pointing_model.pointing_terms import stacked_design

from .base import Effect, Offer, arcsec, effect, form, offer

_MEDIAN_OF_NORMAL = 0.6745  # median absolute value, in sigma
_ROWS = 8000  # values used to estimate the noise
_LOOKS = 1.5  # sigmas of scale that noise may mimic: one in 160 then exceeds 4


@form
def _camera(of, most=None):
    """Camera rotation or scale error; a miss beyond `most` (arcsec) is clipped to it."""
    rotation = of == 'rotation'

    def columns(c):
        x, y = (c.get(name) / ARCSEC for name in ('miss_x', 'miss_y'))
        if most is not None:
            x, y = np.clip(x, -most, most), np.clip(y, -most, most)
        return [(-y, x) if rotation else (x, y)]

    def wording(amount):
        value = amount.values[0]
        if rotation:
            return f'The camera is turned by {abs(np.degrees(value)):.2f}°'
        return f'The plate scale of the camera is wrong by {100 * value:+.1f} %'.replace('-', '−')

    return Effect(f'camera_{of}',
                  'camera turned' if rotation else 'plate scale of the camera wrong',
                  '(-m_y, m_x)' if rotation else '(m_x, m_y)', 'miss_x', 'both',
                  ('angle' if rotation else 'scale',),
                  columns, wording,
                  'the angle of the camera on its flange' if rotation
                  else 'focal length and pixel size that the camera is reduced with',
                  'a part that is in proportion to the miss distance', '',
                  'arcsec/arcsec', requires=('miss_x', 'miss_y'), effort=1 if rotation else 0)


@form
def _off_axis(mount=USUAL):
    """Residual of places measured c beside the line of sight: c^2 / 2 tan of the second angle.

    sin e = sin(e of the tube) cos c: the observed place is always closer to the mount's equator.
    Exact rotations include this in the collimation; a mean of places left and right, or a
    first-order correction of the collimation, leaves it.
    """
    names = KINDS[mount]
    word, letter, sight = names.word('el'), names.letter('el'), names.named('CA')

    def wording(amount):
        value = float(amount.values[0])
        if value < 0.0:
            return (f'The {word} error is −tan {letter} times {arcsec(-value)}: an off-axis '
                    'camera has the other sign')
        beside = np.degrees(np.sqrt(2.0 * value * ARCSEC))
        return (f'The places are those of a camera {beside:.2f}° beside the line of sight, or of '
                f'the mean of several: they leave {arcsec(value)} tan {letter}. No error of the '
                'mount')

    return Effect('off_axis_camera', 'places that look beside the line of sight, as an off-axis '
                  'camera or the mean of several cameras', f'(0, tan {letter})', names.key('el'),
                  'el', ('size',),
                  lambda c: [(0.0, np.clip(np.tan(c.el), -_STEEPEST, _STEEPEST))], wording,
                  f'which camera the places are of: take those of one camera, and {sight} by exact '
                  'rotations',
                  f'a rise toward the pole of the first axis, as tan {letter}',
                  'places of a camera beside the line of sight, or the mean of several', effort=0)


#: tan of the second angle is clipped here
_STEEPEST = 60.0


def propose(context, lacking, own):
    """If the miss distance is known and varies."""
    def build(_):
        # the camera is unknown far beyond the observed miss distances
        far = 1.5 * max(np.nanmax(np.abs(context.get(m))) for m in ('miss_x', 'miss_y')) / ARCSEC
        kinds = ('rotation',) if centred else ('rotation', 'scale')
        return [effect('camera', of=of, most=float(far)) for of in kinds]

    yield Offer('off_axis', [effect('off_axis')])
    unknown = None if context.get('miss_y') is not None else UNKNOWN['miss_y']
    centred = '' if unknown else _too_well_centred(context)
    yield offer('camera', 'camera rotation and scale', context, 'miss_x', build, unknown)
    if centred:
        yield Offer('camera', [], 'camera scale', centred)


def _too_well_centred(context):
    """Reason why the plate scale cannot be determined; '' if it can.

    The noise of a star is in both its miss distance and its offset. That mimics a scale error of
    noise^2 / miss^2, whose sigma is noise / (miss sqrt(2 n)). It stays below `_LOOKS` sigma if
    miss > noise sqrt(2 n) / `_LOOKS`.
    """
    read = [context.get(f'{axis}_enc') for axis in ('az', 'el')]
    miss = [context.get(name) for name in ('miss_x', 'miss_y')]
    if any(value is None for value in (*read, *miss)):
        return ''
    offset = np.array([wrap(read[0] - context.az) * np.cos(context.el),
                       wrap(read[1] - context.el)])
    good = np.isfinite(offset).all(axis=0) & np.isfinite(miss).all(axis=0)
    miss = np.array(miss)
    count = 2 * np.count_nonzero(good)
    # a sample of very many rows is enough for the noise
    good = np.flatnonzero(good)[::1 + count // _ROWS]
    az, el, run = context.az[good], context.el[good], context.get('run')
    design = stacked_design(context.mount.names.physical, az, el, context.mount).T
    if run is not None:  # each run has its own zeros
        members = run[good][:, None] == np.unique(run[good])[1:]
        none = np.zeros_like(members)
        design = np.hstack([design, np.vstack([members * np.cos(el)[:, None], none]),
                            np.vstack([none, members])])
    left = offset[:, good].ravel()
    if len(left) <= design.shape[1]:
        return ''
    left = left - design @ np.linalg.lstsq(design, left, rcond=None)[0]
    noise = np.median(np.abs(left)) / _MEDIAN_OF_NORMAL
    spread = np.sqrt(np.mean(np.square(miss[:, good])))
    least = noise * np.sqrt(count) / _LOOKS
    if spread > least:
        return ''
    return (f'the stars were centred to {spread / ARCSEC:.1f} arcsec, where their noise is '
            f'{noise / ARCSEC:.1f}: that noise looks like a scale. Leave stars uncentred by more '
            f'than {least / ARCSEC:.0f} arcsec')
