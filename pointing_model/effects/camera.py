"""The camera that measures the star's miss distance."""

import numpy as np

from msg_tools.units import ARCSEC

from .base import Effect, effect, form, offer


@form
def _camera(of, most=None):
    """Camera turned, or of a wrong scale; a miss beyond `most` (arcsec) counts as that much."""
    rotation = of == 'rotation'

    def columns(c):
        x, y = (c.get(name) / ARCSEC for name in ('miss_x', 'miss_y'))
        if most is not None:
            x, y = np.clip(x, -most, most), np.clip(y, -most, most)
        return [(-y, x) if rotation else (x, y)]

    def say(amount):
        value = amount.values[0]
        if rotation:
            return f'The camera is turned by {abs(np.degrees(value)):.2f}°'
        return f'The plate scale of the camera is wrong by {100 * value:+.1f} %'.replace('-', '−')

    return Effect(f'camera_{of}',
                  'camera turned' if rotation else 'plate scale of the camera wrong',
                  '(-m_y, m_x)' if rotation else '(m_x, m_y)', 'miss_x', 'both',
                  ('angle' if rotation else 'scale',),
                  columns, say,
                  'the angle of the camera on its flange' if rotation
                  else 'focal length and pixel size that the camera is reduced with',
                  'arcsec/arcsec', requires=('miss_x', 'miss_y'))


def propose(context, lacking, own):
    """Where the miss distance is known and varies."""
    def build(_):
        # far beyond what was seen nothing is known of the camera
        far = 1.5 * max(np.nanmax(np.abs(context.get(m))) for m in ('miss_x', 'miss_y')) / ARCSEC
        return [effect('camera', of=of, most=float(far)) for of in ('rotation', 'scale')]
    yield offer('camera', 'camera rotation and scale', context, 'miss_x', build,
                None if context.get('miss_y') is not None else 'miss_y is not known')
