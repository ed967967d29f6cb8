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

"""What may move in a mount through a night, how fast, how often, and which sensor shows it.

The state of the filter is what the terms are beyond the model of the evening, and for each further
sensor what it would show. A cause is a direction in that state: an incremental encoder that loses
counts moves the zero of its axis and the difference of the two encoders, a tube that creeps the
zero alone, an absolute encoder the difference alone. So the sensors tell which it was.

Where the figures come from
---------------------------
`ZEROS`, `TILTS`
    What telescopes do, and to both sides of it, in steps of 1.65. Of 17 sessions of the IRAM 30 m
    (pointing logs of 2012 and 2014, 655 rows) the likeliest walk of the zeros is 1.3 arcsec in the
    root of an hour, 0.5 to 3 in four of five; of one night of the MMT (80 rows) 0.5 or less. Small
    mounts are worse. All are alike likely until a mount's own nights say more, see
    `history.rates_of_nights`.
`OTHERS`
    Collimation, non-perpendicularity and flexure are of metal and glass. No measured walk was
    found; a twentieth of an arcsecond in the root of an hour, 0.14 in a night of eight, is assumed.
`JUMPS`
    Assumed. Lost counts and slips have no common size: some tens of arcseconds, or minutes of arc.
    Each axis once in five nights of eight hours, which is more often than any mount should; the
    stars overrule it within two.
"""

from dataclasses import dataclass, field

import numpy as np

from msg_tools.units import ARCSEC

from ...estimation.gaussian_sum import PossibleJump

#: rad in the root of an hour, hypotheses for the zeros of both axes and the lean of the first
ZEROS = tuple(ARCSEC * v for v in (0.5, 0.8, 1.3, 2.2, 3.6, 5.9, 9.7, 16.0))
TILTS = tuple(ARCSEC * v for v in (0.2, 0.8, 2.5))
#: of all other terms; of a sensor, and of what is not the one that drifts
OTHERS, QUIET = 0.05 * ARCSEC, 0.3 * ARCSEC
#: (1 sigma, rad; times an hour) of the jumps of an axis
JUMPS = ((40.0 * ARCSEC, 0.02), (300.0 * ARCSEC, 0.005))
#: the same of a pier, where an inclinometer sees it
PIER_JUMPS = ((30.0 * ARCSEC, 0.005),)

#: what can move
INCREMENTAL, ABSOLUTE, TUBE = 'incremental encoder', 'absolute encoder', 'tube or sky'
PIER = 'pier'
#: further sensors that a tracker can be given
SENSORS = ('difference', 'inclinometer')


@dataclass(frozen=True)
class TrackingSettings:
    """How a mount is thought to behave; what is not said is as the module says.

    Attributes
    ----------
    zeros, tilts : tuple of float
        Hypotheses of the walks, rad in the root of an hour.
    walks : dict of str to float
        Of other terms, rad in the root of an hour.
    memory_h : dict of str to float
        Terms that go back to the model of the evening by a factor e in so many hours.
    jumps : tuple of (float, float)
        1 sigma (rad) and times an hour, of each axis.
    wrong, wrong_sigma : float
        Part of the stars that are wrong ones, 1 sigma of what they miss by (rad).
    turn_h : float
        After which a rate is another one, in the mean.
    gap_h : float
        A silence after which nothing is taken for granted: all is widened as from night to night.
    night_zero, night_lean : float
        From night to night, 1 sigma, rad.
    most, depth : int
        Histories kept, stars by which they are distinguished.

    Raises
    ------
    ValueError
        A rate, a size or a chance that cannot be.
    """

    zeros: tuple = ZEROS
    tilts: tuple = TILTS
    walks: dict = field(default_factory=dict)
    memory_h: dict = field(default_factory=dict)
    jumps: tuple = JUMPS
    wrong: float = 0.01
    wrong_sigma: float = 200.0 * ARCSEC
    turn_h: float = 24.0
    gap_h: float = 6.0
    night_zero: float = 20.0 * ARCSEC
    night_lean: float = 3.0 * ARCSEC
    most: int = 12
    depth: int = 4

    def __post_init__(self):
        sizes = (*self.zeros, *self.tilts, *self.walks.values(), *self.memory_h.values(),
                 *(v for pair in self.jumps for v in pair), self.turn_h, self.gap_h,
                 self.wrong_sigma)
        if not self.zeros or not self.tilts or not all(v > 0.0 for v in sizes):
            raise ValueError('tracking: rates, memories and jumps must be positive numbers')
        if not 0.0 < self.wrong < 0.5:
            raise ValueError(f'tracking: {self.wrong} of the stars wrong; take 0 to 0.5')


def states_of(names, sensors):
    """The state of the filter: terms, then what sensors show.

    Parameters
    ----------
    names : sequence of str
        Terms.
    sensors : sequence of str
        Of `SENSORS`.
    """
    out = list(names)
    if 'difference' in sensors:
        out += ['difference_1', 'difference_2']
    if 'inclinometer' in sensors:
        out += ['lean_north', 'lean_west']
    return tuple(out)


def lean_of_base(mount):
    """What terms do when the base of a mount leans by 1 rad to the north, and to the west.

    Parameters
    ----------
    mount : Mount

    Returns
    -------
    list of dict of str to float
        Both, by the names of the terms; first order.
    """
    out = []
    for turn in ((-1.0, 0.0, 0.0), (0.0, -1.0, 0.0)):  # about east, north, up
        x, y, z = np.array(mount.frame) @ turn
        own = {'IA': z, 'AN': -x, 'AW': -y}
        out.append({name: sign * own[canonical]
                    for name, (canonical, sign) in mount.names.terms.items()
                    if canonical in own and abs(own[canonical]) > 1e-12})
    return out


def rate_hypotheses(names, mount, sensors, settings):
    """How fast the state drifts, by each hypothesis.

    Parameters
    ----------
    names : sequence of str
        Terms.
    mount : Mount
    sensors : sequence of str
    settings : TrackingSettings

    Returns
    -------
    rates : ndarray, shape (r, n, n)
        What an hour adds to the covariance, rad^2.
    facts : list of dict
        Of each ``zero`` and ``tilt`` (rad in the root of an hour) and ``who`` drifts.
    """
    states = states_of(names, sensors)
    index, lean = mount.names.index, [mount.names.named(n) for n in ('AN', 'AW')]
    still = {name: settings.walks.get(name, OTHERS) for name in names
             if name not in index and name not in lean}
    base = np.diag([still.get(name, 0.0) ** 2 for name in states])
    who = {TUBE: _spread(states, [{name: 1.0} for name in index])}
    if 'difference' in sensors:
        who[INCREMENTAL] = _spread(states, [
            {name: 1.0, f'difference_{i}': -1.0} for i, name in enumerate(index, 1)])
        base += QUIET**2 * _spread(states, [{'difference_1': 1.0}, {'difference_2': 1.0}])
    tilts = [{name: 1.0} for name in lean if name in states]
    if 'inclinometer' in sensors:
        base += QUIET**2 * _spread(states, [{'lean_north': 1.0}, {'lean_west': 1.0}])
        base += OTHERS**2 * _spread(states, tilts)
        tilts = [{**shape, shown: 1.0} for shape, shown in zip(
            lean_of_base(mount), ('lean_north', 'lean_west'))]
    tilted = _spread(states, tilts)
    rates, facts = [], []
    for zero in settings.zeros:
        for name, moved in who.items():
            for tilt in settings.tilts if tilts else settings.tilts[:1]:
                quiet = sum((QUIET**2 * other for key, other in who.items() if key != name),
                            np.zeros_like(base))
                rates.append(base + zero**2 * moved + quiet + tilt**2 * tilted)
                facts.append({'zero': zero, 'tilt': tilt, 'who': name if len(who) > 1 else ''})
    return np.array(rates), facts


def jumps_of(names, mount, sensors, settings):
    """A `PossibleJump` of each size: of each axis, and of each cause that sensors distinguish."""
    states = states_of(names, sensors)
    causes = []  # name, shape, sizes
    for i, (term, axis) in enumerate(zip(mount.names.index, mount.names.axes), 1):
        shown = f'difference_{i}'
        shapes = {axis: {term: 1.0}}
        if 'difference' in sensors:
            shapes = {f'{INCREMENTAL}, {axis}': {term: 1.0, shown: -1.0},
                      f'{ABSOLUTE}, {axis}': {shown: 1.0}, f'{TUBE}, {axis}': {term: 1.0}}
        causes += [(name, shape, settings.jumps) for name, shape in shapes.items()]
    if 'inclinometer' in sensors:
        for way, shape, shown in zip(('north or south', 'east or west'), lean_of_base(mount),
                                     ('lean_north', 'lean_west')):
            causes.append((f'{PIER}, {way}', {**shape, shown: 1.0}, PIER_JUMPS))
    return [PossibleJump(name, _direction(states, shape), sigma, often)
            for name, shape, sizes in causes for sigma, often in sizes]


def night_to_night(states, mount, settings):
    """What may have changed since another night.

    Parameters
    ----------
    states : sequence of str
        Of `states_of`.
    mount : Mount
    settings : TrackingSettings

    Returns
    -------
    ndarray, shape (n, n)
        rad^2.
    """
    sizes = dict.fromkeys(mount.names.index, settings.night_zero)
    sizes |= {mount.names.named(name): settings.night_lean for name in ('AN', 'AW')}
    sizes |= {name: settings.night_zero for name in states if name.startswith('difference')}
    sizes |= {name: settings.night_lean for name in states if name.startswith('lean')}
    return np.diag([sizes.get(name, 0.0) ** 2 for name in states])


def power_on_change(states, mount, axes, sigma):
    """What an incremental encoder that is switched on does to what is known.

    Parameters
    ----------
    states, mount
        As of `night_to_night`.
    axes : sequence of int
    sigma : float
        By how much its zero is another one, rad.

    Returns
    -------
    ndarray, shape (n, n)
        rad^2.
    """
    return sigma**2 * _spread(states, [
        {mount.names.index[axis]: 1.0, f'difference_{axis + 1}': -1.0} for axis in axes])


def _direction(states, shape):
    return np.array([shape.get(name, 0.0) for name in states])


def _spread(states, shapes):
    """Covariance of states that move by independent steps of 1 along each of some shapes."""
    steps = np.array([_direction(states, shape) for shape in shapes]).reshape(-1, len(states))
    return steps.T @ steps
