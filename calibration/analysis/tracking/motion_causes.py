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

"""What may move in a mount during a night: drift rates, jumps, and the sensors that show them.

The state of the filter is the deviation of the terms from the model of the evening, and the reading
of each further sensor. A cause is a direction in this state. An incremental encoder that loses
counts moves the zero of its axis and the difference of the two encoders, a creeping tube the zero
only, an absolute encoder the difference only. So the sensors distinguish the causes.

Where the figures come from
---------------------------
`ZEROS`, `TILTS`
    The range of real telescopes and beyond on both sides, in steps of 1.65. In 17 sessions of the
    IRAM 30 m (pointing logs of 2012 and 2014, 655 rows) the most likely random walk of the zeros is
    1.3 arcsec/sqrt(h), and 0.5 to 3 in four of five; in one night of the MMT (80 rows) 0.5 or less.
    Small mounts are worse. All are equally likely until nights of the mount are known, see
    `history.rates_of_nights`.
`OTHERS`
    Collimation, non-perpendicularity and flexure depend on metal and glass. No measured random walk
    was found; 0.05 arcsec/sqrt(h), 0.14 arcsec in a night of eight hours, is assumed.
`JUMPS`
    Assumed. Lost counts and slips have no common size: some tens of arcseconds, or arcminutes. Each
    axis jumps once in five nights of eight hours, more often than any mount should; two stars are
    enough to overrule this prior.
"""

from dataclasses import dataclass, field

import numpy as np

from msg_tools.units import ARCSEC

from ...estimation.gaussian_sum import PossibleJump

#: hypotheses on the random walk of the zeros of both axes and of the first axis' tilt, rad/sqrt(h)
ZEROS = tuple(ARCSEC * v for v in (0.5, 0.8, 1.3, 2.2, 3.6, 5.9, 9.7, 16.0))
TILTS = tuple(ARCSEC * v for v in (0.2, 0.8, 2.5))
#: random walk of all other terms; of sensors, and of parts other than the drifting one; rad/sqrt(h)
OTHERS, QUIET = 0.05 * ARCSEC, 0.3 * ARCSEC
#: jumps of an axis: (1 sigma, rad; frequency per hour)
JUMPS = ((40.0 * ARCSEC, 0.02), (300.0 * ARCSEC, 0.005))
#: the same for a pier with an inclinometer
PIER_JUMPS = ((30.0 * ARCSEC, 0.005),)
#: the same of all terms at once
KNOCKS = ((60.0 * ARCSEC, 0.001),)

#: parts that can move
INCREMENTAL, ABSOLUTE, TUBE = 'incremental encoder', 'absolute encoder', 'tube or sky'
PIER, ANY = 'pier', 'mount or camera'
#: further sensors of a tracker
SENSORS = ('difference', 'inclinometer')


@dataclass(frozen=True)
class TrackingSettings:
    """Assumed behaviour of a mount; defaults as in the module.

    Attributes
    ----------
    zeros, tilts : tuple of float
        Hypotheses on the random walks, rad/sqrt(h).
    walks : dict of str to float
        Random walks of other terms, rad/sqrt(h).
    memory_h : dict of str to float
        Relaxation times, h, of terms that return to the model of the evening.
    jumps : tuple of (float, float)
        1 sigma (rad) and frequency per hour, for each axis; the last also of both at once.
    knocks : tuple of (float, float)
        The same of all terms at once; of the zeros five times as large.
    wrong, wrong_sigma : float
        Share of wrong stars, and 1 sigma of their error (rad).
    turn_h : float
        Mean time after which the drift rate changes, h.
    gap_h : float
        Gap without measurements, h, after which the covariance is widened as between nights.
    night_zero, night_lean : float
        Change from night to night, 1 sigma, rad.
    most, depth : int
        Number of histories kept, and number of stars after which they are decided.

    Raises
    ------
    ValueError
        An impossible rate, size or probability.
    """

    zeros: tuple = ZEROS
    tilts: tuple = TILTS
    walks: dict = field(default_factory=dict)
    memory_h: dict = field(default_factory=dict)
    jumps: tuple = JUMPS
    knocks: tuple = KNOCKS
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
                 *(v for pair in (*self.jumps, *self.knocks) for v in pair), self.turn_h,
                 self.gap_h, self.wrong_sigma)
        if not self.zeros or not self.tilts or not all(v > 0.0 for v in sizes):
            raise ValueError('tracking: rates, memories and jumps must be positive numbers')
        if not 0.0 < self.wrong < 0.5:
            raise ValueError(f'tracking: {self.wrong} of the stars wrong; take 0 to 0.5')


def states_of(names, sensors):
    """Names of the filter states: terms, then readings of sensors.

    Parameters
    ----------
    names : sequence of str
        Terms.
    sensors : sequence of str
        Some of `SENSORS`.
    """
    out = list(names)
    if 'difference' in sensors:
        out += ['difference_1', 'difference_2']
    if 'inclinometer' in sensors:
        out += ['lean_north', 'lean_west']
    return tuple(out)


def lean_of_base(mount):
    """Change of the terms when the base of a mount tilts by 1 rad to the north, and to the west.

    Parameters
    ----------
    mount : Mount

    Returns
    -------
    list of dict of str to float
        For both tilts, by names of terms; first order.
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
    """Drift rate of the state for each hypothesis.

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
        Growth of the covariance per hour, rad^2.
    facts : list of dict
        For each ``zero`` and ``tilt`` (rad/sqrt(h)), and ``who`` drifts.
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
    """A `PossibleJump` of each size for each axis and each cause that sensors distinguish.

    And of both axes at once, as at a restart. Both encoders show that in each axis by itself.
    """
    states = states_of(names, sensors)
    causes = []  # name, shapes, sizes
    for i, (term, axis) in enumerate(zip(mount.names.index, mount.names.axes), 1):
        shown = f'difference_{i}'
        shapes = {axis: {term: 1.0}}
        if 'difference' in sensors:
            shapes = {f'{INCREMENTAL}, {axis}': {term: 1.0, shown: -1.0},
                      f'{ABSOLUTE}, {axis}': {shown: 1.0}, f'{TUBE}, {axis}': {term: 1.0}}
        causes += [(name, [shape], settings.jumps) for name, shape in shapes.items()]
    if 'difference' not in sensors:
        causes.append((' and '.join(mount.names.axes), [{term: 1.0} for term in mount.names.index],
                       settings.jumps[-1:]))
    if 'inclinometer' in sensors:
        for way, shape, shown in zip(('north or south', 'east or west'), lean_of_base(mount),
                                     ('lean_north', 'lean_west')):
            causes.append((f'{PIER}, {way}', [{**shape, shown: 1.0}], PIER_JUMPS))
    # a mount that was knocked, a camera that was exchanged: the zeros by more than other terms
    causes.append((ANY, [{name: 5.0 if name in mount.names.index else 1.0} for name in names],
                   settings.knocks))
    return [PossibleJump(name, _steps(states, shapes).T, sigma, often)
            for name, shapes, sizes in causes for sigma, often in sizes]


def night_to_night(states, mount, settings):
    """Covariance of the changes from night to night.

    Parameters
    ----------
    states : sequence of str
        Result of `states_of`.
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
    """Covariance of the change when an incremental encoder is switched on.

    Parameters
    ----------
    states, mount
        See `night_to_night`.
    axes : sequence of int
    sigma : float
        1 sigma of the change of its zero, rad.

    Returns
    -------
    ndarray, shape (n, n)
        rad^2.
    """
    return sigma**2 * _spread(states, [
        {mount.names.index[axis]: 1.0, f'difference_{axis + 1}': -1.0} for axis in axes])


def _steps(states, shapes):
    """Unit steps along some shapes, shape (m, n)."""
    return np.array([[shape.get(name, 0.0) for name in states] for shape in shapes]).reshape(
        -1, len(states))


def _spread(states, shapes):
    """Covariance of states that move by independent unit steps along some shapes."""
    steps = _steps(states, shapes)
    return steps.T @ steps
