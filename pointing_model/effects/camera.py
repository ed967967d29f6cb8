"""The camera that measures the star's miss distance."""

import numpy as np

from msg_tools.units import ARCSEC

from .base import Effect, effect, form, offer


@form
def _camera(of):
    rotation = of == 'rotation'

    def say(amount):
        value = amount.values[0]
        if rotation:
            return f'The camera is turned by {abs(np.degrees(value)):.2f}°'
        return f'The plate scale of the camera is wrong by {100 * value:+.1f} %'.replace('-', '−')

    return Effect(f'camera_{of}',
                  'camera turned' if rotation else 'plate scale of the camera wrong',
                  '(-m_y, m_x)' if rotation else '(m_x, m_y)', 'miss_x', 'both',
                  ('angle' if rotation else 'scale',),
                  lambda c: [(-c.get('miss_y') / ARCSEC, c.get('miss_x') / ARCSEC) if rotation
                             else (c.get('miss_x') / ARCSEC, c.get('miss_y') / ARCSEC)], say,
                  'the angle of the camera on its flange' if rotation
                  else 'focal length and pixel size that the camera is reduced with',
                  'arcsec/arcsec', requires=('miss_x', 'miss_y'))


def propose(context, lacking, own):
    """Where the miss distance is known and varies."""
    yield offer('camera', 'camera rotation and scale', context, 'miss_x',
                lambda _: [effect('camera', of=of) for of in ('rotation', 'scale')])
