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

"""Causes that depend on the past, for `mount_causes.py`: temperatures, slews, a rotator."""

import numpy as np
from mount_cause_nights import Cause, U, _first, _second

from msg_tools.units import DEG

_STEP = 20.0  # s of the log of temperatures


def _log(c, mount, rng, tau):
    """Air temperature at the rows, read to 0.05 degrees, and of a part with time constant `tau`.

    The night has cooled and gusts have passed for three hours before the first row.
    """
    seconds = c['time'] - c['time'][0]
    t = np.arange(-10800.0, seconds[-1] + _STEP, _STEP)
    hours = t / 3600.0
    air = (10.0 - rng.uniform(2.0, 5.0) * (1.0 - np.exp(-hours / rng.uniform(0.7, 2.5)))
           + rng.uniform(0.5, 1.5) * np.sin(2.0 * np.pi * hours / rng.uniform(0.8, 2.5)
                                            + rng.uniform(0.0, 6.3)))
    part = air.copy()
    for i in range(1, len(t)):
        part[i] = part[i - 1] + (air[i] - part[i - 1]) * -np.expm1(-_STEP / tau)
    return {'temperature': np.interp(seconds, t, air) + 0.05 * rng.normal(size=len(seconds)),
            '_part': np.interp(seconds, t, part)}


def _late(c, mount, rng):
    return _log(c, mount, rng, 60.0 * rng.choice([20.0, 40.0, 60.0]))


def _truss(c, mount, rng):
    """A thermometer on the truss, in a file without times and weather."""
    part = _log(c, mount, rng, 1500.0)['_part']
    none = dict.fromkeys(('time', 'temperature', 'approach_az', 'approach_el', 'magnitude',
                          'miss_x', 'miss_y'))
    return {**none, 'truss_temp': part + 0.05 * rng.normal(size=len(part)), '_part': part}


def _sagging(c, mount, rng):
    """A tube that bends by its weight across it, and more when it is warm."""
    a, e, pulls = c['az'], c['el'], []
    for da, de in ((1e-5, 0.0), (0.0, 1e-5)):  # how fast the height grows along either axis
        up = [np.sin(mount.horizon_of(a + s * da, e + s * de)[1]) for s in (-0.5, 0.5)]
        pulls.append((up[1] - up[0]) / 1e-5)
    return U * (c['_part'] - c['_part'].mean()) * np.array([pulls[0] / np.cos(e), pulls[1]])


def _across(c, mount, rng):
    """A cell that moves to one side of the tube."""
    return U * np.array([c['_part'] - c['_part'].mean(), 0.0 * c['_part']])


def _secondary(c, mount, rng):
    """A secondary mirror in its cell: on its back at the zenith, on its edge at the horizon."""
    towards, warm = rng.uniform(0.0, 2.0 * np.pi), c['temperature'] - c['temperature'].mean()
    return _second(U * warm * np.sin(c['el'] + towards))


def _slip(c, mount, rng):
    """A clutch lets go in one slew."""
    n = len(c['az'])
    after = U * (np.arange(n) >= rng.integers(6, n - 6))
    return _first(c, after) if rng.integers(0, 2) else _second(after)


def _long_slews(c, mount, rng):
    """A friction wheel slips in slews of more than some length, against the motion."""
    axis = ('az', 'el')[rng.integers(0, 2)]
    way = np.diff(c[axis], prepend=c[axis][0])  # as the sides of approach say
    count = rng.integers(4, len(way) // 3)
    slips = np.cumsum(np.sign(way) * (np.abs(way) >= np.sort(np.abs(way))[-count]))
    return _first(c, U * slips) if axis == 'az' else _second(U * slips)


def _rotator(c, mount, rng):
    return {'rotator_deg': rng.uniform(-180.0, 180.0, len(c['az']))}


def _beside(c, mount, rng):
    """The middle of a camera goes round the axis of its rotator."""
    angle = rng.choice((-1, 1)) * c['rotator_deg'] * DEG + rng.uniform(0.0, 6.3)
    return U * np.array([np.cos(angle), np.sin(angle)])


_WARM = ((60, 14.0), (120, 14.0))
HISTORIES = {
    'flexure, late temperature': Cause(
        ('flexure_with_temperature',), _sagging, prepare=_late, sizes=_WARM,
        alike=('elevation_zero_with_temperature', 'secondary_with_temperature')),
    'collimation, late': Cause(
        ('collimation_with_temperature',), _across, ('altaz',), prepare=_late, sizes=_WARM,
        alike=('azimuth_zero_with_temperature',)),
    'flexure, truss': Cause(
        ('flexure_with_truss_temp',), _sagging, prepare=_truss, sizes=_WARM,
        alike=('truss_temp', 'secondary_with_truss_temp')),
    'secondary, temperature': Cause(
        ('secondary_with_temperature',), _secondary, ('altaz',), prepare=_late, sizes=_WARM,
        alike=('flexure_with_temperature', 'elevation_zero_with_temperature')),
    'slip of one slew': Cause(
        ('azimuth_zero_step', 'elevation_zero_step', 'hour_angle_zero_step',
         'declination_zero_step'), _slip),
    'slips of long slews': Cause(
        ('azimuth_slip', 'elevation_slip', 'hour_angle_slip', 'declination_slip'), _long_slews,
        alike=('azimuth_zero_step', 'elevation_zero_step', 'hour_angle_zero_step',
               'declination_zero_step')),
    'rotator': Cause(('rotator_offset',), _beside, prepare=_rotator),
}
