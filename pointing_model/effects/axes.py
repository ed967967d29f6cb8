"""Encoders and bearings: what repeats so many times a turn of an axis."""

import numpy as np

from .base import AXES, Effect, Offer, arcsec, effect, form, on_axis, times


@form
def _encoder(axis, order):
    """Harmonic of an encoder, `order` a turn."""
    k = int(order)
    az = axis == 'az'
    letter = 'A' if az else 'E'

    def of(c):
        angle = k * (c.az if az else c.el)
        return [on_axis(axis, f(angle), c.trig.cos_el) for f in (np.cos, np.sin)]

    cause, short, look_at = {
        1: ('encoder disc off its centre', 'its disc is off centre',
            'the centring of the disc; the mean of two heads opposite each other'),
        2: ('encoder disc oval or tilted, or two heads uneven', 'its disc is oval or tilted',
            'the tilt of the disc on its hub; the distance of both heads'),
    }.get(k, ('encoder or its coupling uneven', 'it or its coupling is uneven',
              'the coupling between axis and encoder, and the disc for dirt'))

    def say(amount):
        head = f'The {AXES[axis]} encoder is wrong '
        if amount.rms is not None and amount.rms < 0.2 * amount.size:
            return f'{head}{times(order)}: {short}'  # most of it other terms would take up
        return f'{head}by up to {arcsec(amount.size)}, {times(order)}: {short}'

    # source: geometry of a disc off its axis, or tilted; neither paper has it
    return Effect(f'{AXES[axis]}_encoder_{k}', f'{AXES[axis]} {cause}: {k} a turn',
                  f'cos {k}{letter}, sin {k}{letter} on the {AXES[axis]} angle'
                  + (' (on the sky x cos E)' if az else ''),
                  AXES[axis], axis, ('cos', 'sin'), of, say, look_at,
                  tpoint=f'{letter}CEC {letter}CES' if k == 1 else
                  f'H{letter}C{letter}{k} H{letter}S{letter}{k}')


@form
def _bearing_wobble(order):
    k = int(order)

    def of(c):
        ca, sa, se = np.cos(k * c.az), np.sin(k * c.az), c.trig.sin_el
        return [(0.0, ca), (0.0, sa), (se * ca, 0.0), (se * sa, 0.0)]

    return Effect(f'azimuth_bearing_wobble_{k}',
                  f'azimuth axis wobbles {k} a turn: bearing or track not flat',
                  f'(0, cos {k}A), (0, sin {k}A), (sin E cos {k}A, 0), (sin E sin {k}A, 0)',
                  'azimuth', 'both', ('el_cos', 'el_sin', 'az_cos', 'az_sin'), of,
                  lambda amount: f'The azimuth axis wobbles by up to {arcsec(amount.size)}, '
                  f'{times(order)}: a bearing or track that is not flat',
                  'flatness of the azimuth bearing or track, with a level on the fork',
                  tpoint='HECA HESA HVCA HVSA' if k == 1 else f'HECA{k} HESA{k} HVCA{k} HVSA{k}')


@form
def _nod(order):
    k = int(order)
    return Effect(f'elevation_nod_{k}', f'the mount nods {k} a turn of azimuth',
                  f'(0, cos {k}A), (0, sin {k}A)', 'azimuth', 'el', ('cos', 'sin'),
                  lambda c: [(0.0, np.cos(k * c.az)), (0.0, np.sin(k * c.az))],
                  lambda amount: f'The mount nods by {arcsec(amount.size)} in elevation, '
                  f'{times(order)} of the azimuth axis',
                  'wheels or pads under the azimuth axis, and the base under the fork',
                  tpoint='HECA HESA' if k == 1 else f'HECA{k} HESA{k}')


@form
def _line_of_sight(order):
    """Collimation that goes round with the azimuth: TPOINT's harmonics of the left-right error."""
    k = int(order)
    return Effect(f'line_of_sight_{k}', f'the line of sight swings left and right {k} a turn of '
                  'azimuth', f'(cos {k}A, 0), (sin {k}A, 0)', 'azimuth', 'az', ('cos', 'sin'),
                  lambda c: [(np.cos(k * c.az), 0.0), (np.sin(k * c.az), 0.0)],
                  lambda amount: f'The line of sight swings {arcsec(amount.size)} left and right, '
                  f'{times(order)} of the azimuth axis, at any elevation',
                  'what turns with the azimuth and holds the beam: a Nasmyth mirror or the cabin, '
                  'the fork that twists on an uneven track, cables',
                  tpoint=f'HSCA{k} HSSA{k}')


@form
def _elevation_axis_wobble(order):
    k = int(order)
    return Effect(f'elevation_axis_wobble_{k}', f'elevation axis wobbles {k} a turn',
                  f'(sin E cos {k}E, 0), (sin E sin {k}E, 0)', 'elevation', 'az', ('cos', 'sin'),
                  lambda c: [(c.trig.sin_el * np.cos(k * c.el), 0.0),
                             (c.trig.sin_el * np.sin(k * c.el), 0.0)],
                  look_at='run-out of both elevation bearings')


def propose(context, lacking, own):
    """Orders that a mount's parts make; what the axes do is seen in the directions."""
    for axis, highest in (('el', 3), ('az', 6)):
        yield Offer('encoder', [effect('encoder', axis=axis, order=order)
                                for order in range(1, highest + 1)])
    # constant parts of a wobble of the elevation axis: over a sky of less than a quarter turn it
    # would pass for them
    alike = [name for name in ('CA', 'NPAE') if name in lacking]
    against = {'elevation_axis_wobble': 'it looks like terms that the model lacks: '
               + ', '.join(alike)} if alike else {}
    # once a turn (cos A, 0) is nearly a disc off its centre with a wobble of the azimuth axis
    for name, lowest, highest in (('bearing_wobble', 1, 3), ('nod', 1, 6),
                                  ('line_of_sight', 2, 4), ('elevation_axis_wobble', 1, 2)):
        yield Offer(name, [] if name in against else [
            effect(name, order=order) for order in range(lowest, highest + 1)],
            name.replace('_', ' '), against.get(name))
