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

"""The star that best discriminates between possible causes, and whether any star can.

The expected gain of stars in 2 ln(likelihood ratio) between two causes is the part of the true one
that the wrong one cannot fit, averaged over which of them is true (`next_observations.Prospect`).
The standard deviation of the sum is twice its square root (Box and Hill 1967, on discriminating
models).
"""

from statistics import NormalDist

import numpy as np

from msg_tools.units import DEG

from ..finding import Finding
from .next_observations import MIN_GAP, views_of
from .observation_places import (
    SHORT,
    dark_hours,
    next_night,
    observation_context,
    place_of,
    places_under,
)

#: 2 ln(likelihood ratio) from which a cause is excluded: error rate 1 in 100 (Wald 1945)
SEPARATE = 9.2
#: probability of success below which the remaining stars are not worth their time
LEAST_CHANCE = 0.1
#: probability of success that is enough: not to wait longer, or to suggest other observations
ENOUGH = 0.5
#: hours after the last row of a star observed "now", and of later stars, within the hours allowed
_NOW, _LATER = 0.1, (0.5, 1.0, 2.0, 4.0, 8.0)
_ROUNDS = 4  # rounds in which the remaining stars are placed to estimate their total gain
_KELVIN = 8.0
_FAST = 20.0  # times the rate of a star


class Points:
    """Grid of possible observations over all drivers that matter to some effects.

    Parameters
    ----------
    obs : Observations
    drivers : set of str
        Drivers that matter.
    hours : float
        Longest wait, h.
    elevations : (float, float), optional
        Elevation limits of the mount, rad; by default the range of the rows.
    low_deg : float, optional
        Extend the grid down to this elevation.
    warmer, faster : float
        Kelvin above the forecast; multiple of the rate of a star.
    any_magnitude : bool
        Whether magnitudes outside the range of the rows are included.
    only_later : bool
        Exclude "now"; if it is not dark later, use the beginning of the next night.

    Attributes
    ----------
    context : Context
    later : ndarray, shape (m,)
        Hours after the last row.
    short : ndarray of bool, shape (m,)
        Whether the point is reached by a short reversal from a point before.
    """

    def __init__(self, obs, drivers, hours=0.0, elevations=None, low_deg=None, warmer=0.0,
                 faster=1.0, any_magnitude=False, only_later=False):
        known, self._drivers = obs.context, drivers
        above = known.on_horizon()[1]
        low, high = elevations or (max(15.0 * DEG, float(above.min())), float(above.max()))
        low = low if low_deg is None else min(low, low_deg * DEG)
        high = min(88.0 * DEG, max(high, low + 0.1))
        sides = [[-1.0, 1.0] if {f'approach_{axis}', f'before_{axis}'} & drivers else [1.0]
                 for axis in ('az', 'el')]
        later = [h for h in _LATER if h < hours] + [hours] * (hours > 0.0)
        if not {'time', 'order', 'run_hours', 'lst', 'temperature'} & drivers:
            later = []
        dark = dark_hours(known, later)
        if later and only_later:
            later = dark or next_night(known, later)[:1]
        else:
            later = [_NOW, *dark]
        moves = [False, True] if {'travel_az', 'travel_el'} & drivers else [False]
        magnitude = known.get('magnitude')
        bright = [np.nan] if magnitude is None else [np.nanmedian(magnitude)]
        if magnitude is not None and 'magnitude' in drivers:
            bright = [0.0, 9.0] if any_magnitude else [np.nanmin(magnitude), np.nanmax(magnitude)]
        az, el, s_az, s_el, self.later, self.short, bright = places_under(
            known, low, high, *sides, later, moves, bright)
        self.context = observation_context(known, az, el, (s_az, s_el), self.later, self.short,
                                           warmer, magnitude=bright)
        if faster != 1.0:
            for axis in ('az', 'el'):
                rate = self.context.get(f'{axis}_rate')
                if rate is not None:
                    self.context.columns[f'{axis}_rate'] = faster * rate
                    self.context._derived.pop(f'{axis}_rate')
        self._magnitude = bright

    def taken(self, context, rows):
        """Which points have been observed already, shape (m,)."""
        out = np.zeros(len(self.later), bool)
        for i in rows:
            here = np.hypot((self.context.az - context.az[i]) * np.cos(context.el[i]),
                            self.context.el - context.el[i]) < MIN_GAP
            for axis in ('az', 'el'):
                side = context.get(f'approach_{axis}')
                if f'approach_{axis}' in self._drivers and side is not None:
                    here &= self.context.columns[f'approach_{axis}'] == side[i]
            out |= here
        return out

    def request(self, j):
        """Point `j` as a suggested observation, see `discrimination.CauseStanding`."""
        c, drivers = self.context, self._drivers
        sides = {f'approach_{axis}': int(c.columns[f'approach_{axis}'][j])
                 if {f'approach_{axis}', f'before_{axis}'} & drivers else 0
                 for axis in ('az', 'el')}
        out = {
            **place_of(c, j), **sides,
            'last_move_deg': float(SHORT / DEG) if self.short[j] else None,
            'before': None,
            'after_hours': float(self.later[j]) if self.later[j] > _NOW else None,
            'magnitude': float(self._magnitude[j]) if 'magnitude' in drivers else None}
        if self.short[j]:
            # a point to observe first, a short move away, reached from the other side
            ways = [out[f'approach_{axis}'] or 1 for axis in ('az', 'el')]
            az, el = c.mount.horizon_of(c.az[j] - ways[0] * SHORT / np.cos(c.el[j]),
                                        c.el[j] - ways[1] * SHORT)
            out['before'] = {
                'az_deg': float(az / DEG) % 360.0, 'el_deg': float(el / DEG),
                **{side: -value for side, value in sides.items()}}
        return out


def drivers_of(effects):
    """Drivers of some effects, set of str."""
    return {d for e in effects for d in (e.driver, *e.requires)}


class Pair:
    """The best cause and a rival, compared at possible observations.

    Parameters
    ----------
    problem, obs, base, fit, pair, others
        See `next_observations.views_of`.
    points : Points
    behind : float
        Distance of the rival in 2 ln(likelihood ratio).

    Attributes
    ----------
    hours : float
        Hours until the last of its points.
    """

    def __init__(self, problem, obs, base, fit, pair, others, points, behind):
        self._views = views_of(problem, obs, base, fit, [[e] for e in pair], others,
                               points.context)
        self.behind, self.hours = behind, float(points.later.max())
        right = 1.0 / (1.0 + np.exp(-0.5 * behind))
        self._right = right, 1.0 - right

    def differ(self):
        """Squared difference of the two at each point in units of the noise, shape (m,).

        This is the gain of a star there without a refit of the terms. With a refit the gain is less
        far from the rows, where terms are poorly known: such points were then avoided, and more
        stars were needed (benchmarks/tell_apart.py: a median of 4 in place of 2 and 3, 8 in place
        of 6).
        """
        return sum(p * v.disagreement() for p, v in zip(self._right, self._views))

    def chance(self, stars, allowed=None):
        """Probability that a number of stars, at the best points, excludes one of the two.

        Parameters
        ----------
        stars : int
        allowed : ndarray of bool, shape (m,), optional
            Points that may be used.
        """
        out = 0.0
        for p, view, lead in zip(self._right, self._views, (self.behind, -self.behind)):
            view, before, left = view.copy(), view.separation(), stars
            for k in range(min(_ROUNDS, stars), 0, -1):
                part, gain = left / k, view.disagreement()
                view.add(int(np.argmax(gain if allowed is None else np.where(allowed, gain, 0.0))),
                         part)
                left -= part
            adds = max(view.separation() - before, 1e-9)
            out += p * NormalDist().cdf((lead + adds - SEPARATE) / (2.0 * np.sqrt(adds)))
        return float(out)


def needed(make, stars):
    """A Finding on other observations that would discriminate between a pair.

    Parameters
    ----------
    make : callable
        Returns the `Pair` for some options of `Points`.
    stars : int
        Number of stars observed.
    """
    for kind, size, options in (
            ('low stars needed', 10.0, {'low_deg': 10.0}),
            ('magnitudes needed', None, {'any_magnitude': True}),
            ('later stars needed', None, {'hours': 2.0, 'only_later': True}),
            ('later stars needed', None, {'hours': 8.0, 'only_later': True}),
            ('warmer stars needed', _KELVIN, {'warmer': _KELVIN}),
            ('warmer stars needed', -_KELVIN, {'warmer': -_KELVIN}),
            ('fast target needed', None, {'faster': _FAST})):
        pair = make(**options)
        if pair.chance(stars) >= ENOUGH:
            if 'hours' in options:
                size = pair.hours
            return Finding(kind, size, unit='', evidence={
                'tonight': pair.hours <= options.get('hours', np.inf)})
    pair = make()
    for more in (2, 4):
        if pair.chance(more * stars) >= ENOUGH:
            return Finding('more stars needed', more * stars, unit='stars')
    return Finding('alike on all stars')
