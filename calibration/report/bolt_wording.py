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

"""Words for polar alignment: which bolt to turn, which way, how far."""

import numpy as np

from msg_tools.units import ARCSEC, DEG
from pointing_model.bolts_and_feet import polar_axis

#: an error below this many standard errors is not worth a turn
_CLEAR = 2.0
TRUE, REFRACTED = 'true', 'refracted'


def alignment_document(model, refraction=0.0, equinox=None):
    """Direction of the polar axis of a model, for JSON.

    Parameters
    ----------
    model : PointingModel
    refraction : float
        Refraction of the pole to align to, rad; 0: the true pole.
    equinox : dict, optional
        The assumed equinox of the catalogue, ``meta['equinox_taken']`` of a run.

    Returns
    -------
    dict or None
        None for a mount without a polar axis. ``unknown``: why nothing is known, or None. Else
        ``axis_azimuth_deg`` and ``axis_altitude_deg`` of the end above the horizon, ``pole`` (true
        or refracted, its altitude and refraction), ``south``, and the errors, axis - pole, with
        their sigmas: ``azimuth_…``, ``altitude_…``, ``pole_distance_…`` (the angle between);
        ``equinox``, if it is a guess.
    """
    if not model.mount.celestial:
        return None
    try:
        return {**axis_document(polar_axis(model, refraction), bool(refraction)),
                'equinox': None if equinox is None or equinox['told'] else equinox}
    except ValueError as error:
        return {'unknown': str(error)}


def axis_document(axis, refracted=False):
    """A `PolarAxis` for `alignment_document`; `refracted`: the target is the refracted pole."""
    sigma_az, sigma_alt = axis.sigmas
    size, sigma = axis.pole_distance
    return {'unknown': None, 'south': axis.south,
            'pole': {'which': REFRACTED if refracted else TRUE, 'altitude_deg': axis.pole / DEG,
                     'refraction_arcsec': (axis.pole - abs(axis.latitude)) / ARCSEC},
            'axis_azimuth_deg': axis.azimuth / DEG, 'axis_altitude_deg': axis.altitude / DEG,
            'pole_distance_arcsec': size / ARCSEC, 'pole_distance_sigma_arcsec': sigma / ARCSEC,
            'azimuth_error_arcsec': axis.azimuth_error / ARCSEC,
            'azimuth_sigma_arcsec': sigma_az / ARCSEC,
            'altitude_error_arcsec': axis.altitude_error / ARCSEC,
            'altitude_sigma_arcsec': sigma_alt / ARCSEC}


def alignment_lines(found, per_turn=None):
    """How to turn the bolts, in sentences.

    Parameters
    ----------
    found : dict
        Result of `alignment_document`.
    per_turn : pair of float, optional
        Motion per turn of the azimuth and the altitude bolt, arcsec.

    Returns
    -------
    list of str
    """
    if found['unknown']:
        return [f'how to turn the bolts is not known: {found["unknown"]}']
    pole = found['pole']
    return [
        *_if_so(found.get('equinox')),
        f'The polar axis points {angle_text(found["pole_distance_arcsec"])} '
        f'± {angle_text(found["pole_distance_sigma_arcsec"])} from the {pole["which"]} pole '
        f'(altitude {pole["altitude_deg"]:.4f}°'
        + f', {pole["refraction_arcsec"]:.0f}″ above the true one' * (pole['which'] == REFRACTED)
        + ').',
        azimuth_line(found, per_turn and per_turn[0]),
        altitude_line(found, per_turn and per_turn[1])]


def _if_so(equinox):
    """A warning if the equinox of the star positions is a guess."""
    if not equinox:
        return []
    taken, other = (equinox['polar_axis_arcsec'].get(equinox[k], {}) for k in ('taken', 'other'))
    moved = ', '.join(f'{name} by {angle_text(other[name] - value)}'
                      for name, value in taken.items() if name in other)
    return [f'Give the equinox of the catalogue (--equinox) before you turn a bolt: '
            f'{equinox["taken"]} is a guess; {equinox["other"]} moves '
            f'{moved or "the axis"}.']


def azimuth_line(found, per_turn=None):
    """How to turn the azimuth bolt."""
    error, sigma = found['azimuth_error_arcsec'], found['azimuth_sigma_arcsec']
    # azimuth increases clockwise; in the south the axis moves the other way along the horizon
    way = 'clockwise' if error < 0.0 else 'anticlockwise'
    to = 'east' if (error < 0.0) != found['south'] else 'west'
    return _line('Azimuth bolt', error, sigma, per_turn,
                 f'turn the base {{}} {way}, seen from above (the axis goes {to})')


def altitude_line(found, per_turn=None):
    """How to turn the altitude bolt."""
    error, sigma = found['altitude_error_arcsec'], found['altitude_sigma_arcsec']
    return _line('Altitude bolt', error, sigma, per_turn,
                 f'{"raise" if error < 0.0 else "lower"} the axis by {{}}')


def _line(bolt, error, sigma, per_turn, text):
    size = f'{angle_text(abs(error))} ± {angle_text(sigma)}'
    if abs(error) < _CLEAR * sigma:
        return f'{bolt}: leave it; the axis is off by {size}, within its error.'
    turns = f': {abs(error) / per_turn:.2f} turns' if per_turn else ''
    return f'{bolt}: {text.format(size)}{turns}.'


def angle_text(arcsec):
    """An angle of any size, with its unit."""
    if round(abs(arcsec), 1) < 100.0:
        return f'{abs(arcsec):.1f}″'
    minutes, seconds = divmod(round(abs(arcsec)), 60)
    degrees, minutes = divmod(minutes, 60)
    return f'{degrees}° ' * (degrees > 0) + f'{minutes}′ {seconds:02d}″'


def shim_line(shim, unit='mm'):
    """Where to put a `Shim`; left and right as seen from behind the tube."""
    size = f'{angle_text(shim.angle / ARCSEC)} ± {angle_text(shim.sigma / ARCSEC)}'
    if abs(shim.angle) < _CLEAR * shim.sigma:
        return f'Cone error: no shim; {size} is within its error.'
    return (f'Cone error: {size} to the {"left" if shim.rear else "right"}. Shim of '
            f'{shim.thickness:.3f} ± {shim.thickness_sigma:.3f} {unit} between tube and saddle, '
            f'at the {"rear" if shim.rear else "front"} end.')


def feet_lines(feet, unit='mm'):
    """How far to lift the feet of a base, in sentences."""
    lines = [f'The azimuth axis tilts {angle_text(feet.tilt / ARCSEC)} toward azimuth '
             f'{feet.toward / DEG:.1f}°.']
    if (feet.lifts < _CLEAR * feet.sigmas).all():
        return [*lines, 'Feet: leave them; their lifts are within their errors.']
    return lines + [
        f'Foot {i} (azimuth {azimuth / DEG:.0f}°): '
        + (f'lift by {lift:.3f} ± {sigma:.3f} {unit}.' if lift else 'leave it.')
        for i, (azimuth, lift, sigma) in enumerate(
            zip(np.mod(feet.azimuths, 2.0 * np.pi), feet.lifts, feet.sigmas), 1)]


def watch_lines(reading, found, near, per_turn=None):
    """Result of an image while the bolts are turned, in sentences.

    Parameters
    ----------
    reading : telescope_mount.bolt_watch.BoltReading
    found : dict or None
        Result of `axis_document`.
    near : bool
        Whether the axis is close enough to the pole.
    per_turn : pair of float, optional
        See `alignment_lines`.

    Returns
    -------
    list of str
    """
    if reading.kind == 'collected':
        lines = [f'Image {reading.count} of 3 is solved: '
                 + ('turn the hour axis, and take the next.' if reading.count < 3 else '')]
        return lines + ([f'From this image alone: {line}' for line in _both(found, per_turn)]
                        if found else [])
    if reading.kind == 'stopped':
        now = found[f'{reading.bolt}_error_arcsec']
        return [f'Stop: the error in {reading.bolt} has doubled, from '
                f'{angle_text(reading.before / ARCSEC)} to {angle_text(now)}.',
                'The bolt was turned the wrong way, or a sign of the readings is wrong. Take three '
                'images anew.']
    by = ('Three images are solved' if reading.kind == 'three' else
          'One image is solved, only the bolts fitted')
    lines = [f'{by}: the axis is {angle_text(found["pole_distance_arcsec"])} '
             f'± {angle_text(found["pole_distance_sigma_arcsec"])} from the '
             f'{found["pole"]["which"]} pole.']
    if reading.moved:
        az, alt = (angle_text(v / ARCSEC) for v in reading.moved)
        lines.append(f'Since the last image it moved by {az} in azimuth and {alt} in altitude.')
    if near and reading.kind == 'three' and reading.again:
        return [*lines, 'Done: measured once more after the bolts were locked.']
    lines += _both(found, per_turn)
    if near:
        lines.append('Lock the bolts, then take three images with the hour axis turned between '
                     'them.')
    return lines


def _both(found, per_turn):
    return [azimuth_line(found, per_turn and per_turn[0]),
            altitude_line(found, per_turn and per_turn[1])]
