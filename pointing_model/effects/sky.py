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

"""Sky and clock: aberration, equinox, proper motion, time, site, latency."""

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.mount_kinds import KINDS, USUAL
from pointing_model.pointing_terms import TERMS

from .base import Effect, Offer, effect, form, offer

_STARS = 'catalogue, equinox and corrections of the star places'
#: aberration, arcsec: by the speed of the Earth over the year (its orbit is elliptic), and by the
#: rotation at the equator
_ANNUAL, _DIURNAL = (20.15, 20.84), 0.3193
_CLOCK = 'clock of the control computer, UT1 - UTC, coordinates of the site'


def _displaced(c, vector):
    """Offset (x, y) for a displacement of the direction by `vector`, shape (3, n)."""
    return tuple(np.sum(vector * t, axis=0) for t in c.tangent())


@form
def _annual_aberration():
    return Effect('annual_aberration', 'annual aberration left out of the star places',
                  'the part across the line of sight of a dipole fixed among the stars', 'lst',
                  'both', ('X', 'Y', 'Z'),
                  lambda c: [_displaced(c, axis) for axis in c.equatorial()]
                  if c.equatorial() is not None else [(np.nan, np.nan)] * 3,
                  lambda _: 'The star places lack the annual aberration (20.5″)', _STARS,
                  'a pull toward one direction among the stars', requires=('lst',), size=_ANNUAL,
                  effort=0)


@form
def _diurnal_aberration(latitude=None):
    most = _DIURNAL * (1.0 if latitude is None else float(np.cos(latitude)))
    return Effect('diurnal_aberration',
                  'diurnal aberration left out of the star places (0.32" cos latitude)',
                  '(cos A, -sin E sin A)', 'azimuth', 'both', ('east',),
                  lambda c: [_displaced(c, np.array([[1.0], [0.0], [0.0]]))],
                  lambda _: 'The star places lack the diurnal aberration (0.3″)', _STARS,
                  'a pull toward the east', size=(0.0 if latitude is None else most, most),
                  effort=0)


@form
def _epoch_error():
    def of(c):
        axes = c.equatorial()
        if axes is None:
            return [(np.nan, np.nan)] * 2
        return [_displaced(c, np.cross(axis, c.direction(), axis=0)) for axis in axes[:2]]

    return Effect('precession_or_epoch_error',
                  'star places of a wrong equinox: precession left out or applied twice',
                  'rotation about the equatorial X and Y axes', 'lst', 'both', ('X', 'Y'), of,
                  lambda _: 'The star places lack the right equinox: precession is left out or '
                  'applied twice', _STARS, 'a turn of the whole sky', requires=('lst',),
                  effort=0)


@form
def _proper_motion():
    return Effect('proper_motion', 'proper motion of the stars left out',
                  'proper motion on the sky x years', 'star', 'both', ('years',),
                  lambda c: [(c.get('pm_x'), c.get('pm_y'))],
                  lambda _: 'The star places lack the proper motion of the stars', _STARS,
                  'the pattern of the proper motions of the stars',
                  unit='yr', requires=('pm_x', 'pm_y'), effort=0)


@form
def _clock(latitude, mount=USUAL):
    kind = KINDS[mount]
    alias = 'IA + AW' if kind.vertical else 'IH' if kind.celestial else ''
    pole = np.array([[0.0], [np.cos(latitude)], [np.sin(latitude)]])
    return Effect('clock_or_longitude', 'clock, UT1 or longitude wrong (15" a second of time)',
                  'rotation about the pole', 'azimuth', 'az' if alias == 'IH' else 'both',
                  ('hour_angle',),
                  lambda c: [_displaced(c, -np.cross(pole, c.direction(), axis=0))], look_at=_CLOCK,
                  shape='a turn about the pole', effort=0,
                  alias=f'clock and longitude are exactly {alias}: no pointing run can distinguish '
                        f'them from {"these terms" if mount == "altaz" else "this term"}'
                        if alias else None)


@form
def _latitude():
    return Effect('latitude', 'latitude wrong', 'the columns of AN', 'azimuth', 'both',
                  ('latitude',), lambda c: [TERMS['AN'].of(c.trig)], look_at=_CLOCK,
                  shape='a tilt to the north', effort=0,
                  alias='latitude is exactly AN: no pointing run can distinguish the two')


@form
def _latency(mount=USUAL):
    exactly = 'IA + AW' if KINDS[mount].vertical else 'IH'

    def wording(amount):
        word = 'late' if amount.values[0] > 0 else 'early'
        return f'Angles are read or stamped {abs(amount.values[0]):.3f} s too {word}'

    return Effect('latency', 'angles read or stamped too late (or early)',
                  '(azimuth rate x cos E, elevation rate) x delay', 'az_rate', 'both', ('delay',),
                  lambda c: [(c.get('az_rate') * c.trig.cos_el / ARCSEC,
                              c.get('el_rate') / ARCSEC)], wording,
                  'where the time stamp is taken: at the latch of the encoder, or after the bus',
                  'a part that is in proportion to the speed of the axes',
                  unit='s', requires=('az_rate', 'el_rate'), effort=0,
                  alias=f'at sidereal rate latency is exactly a clock error, {exactly}: only '
                        'satellites or slews show it'
                        if KINDS[mount].vertical or KINDS[mount].celestial else None)


def propose(context, lacking, own):
    """Effects that need the site, sidereal time, catalogue stars or rates."""
    yield Offer('diurnal_aberration', [effect(
        'diurnal_aberration', latitude=None if context.latitude is None
        else float(context.latitude))])
    # the same columns; on other mounts the latitude does not act through the axes
    if context.mount.vertical and 'AN' not in lacking:
        yield Offer('latitude', [effect('latitude')])
    if context.latitude is None:
        yield Offer('clock', [], 'clock_or_longitude', 'the latitude of the site is not known')
    else:
        yield Offer('clock', [effect('clock', latitude=float(context.latitude))])
    if context.equatorial() is None:
        yield Offer('annual_aberration', [], 'annual_aberration, precession_or_epoch_error',
                    'the sidereal time is not known' if context.latitude is not None
                    else 'the latitude of the site is not known')
    else:
        for name in ('annual_aberration', 'epoch_error'):
            yield Offer(name, [effect(name)])
    yield offer('proper_motion', 'proper motion', context, 'pm_x',
                lambda _: [effect('proper_motion')])
    yield offer('latency', 'latency', context, 'az_rate', lambda _: [effect('latency')])
