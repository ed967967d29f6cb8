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

"""Choice of the next star: expected information per time.

The information in a star does not depend on its measured value: the covariance after it follows
from its place (Fedorov 1972, Theory of optimal experiments). A star is rated by the decrease of the
mean square pointing error over the places that matter, per second of slew and exposure.
"""

from dataclasses import dataclass

import numpy as np

from msg_tools.units import ARCSEC, DEG
from pointing_model.rms import rms


@dataclass(frozen=True)
class SlewTime:
    """Slew model of a mount: both axes move at once, each at its rate, and then settle.

    Attributes
    ----------
    rates : (float, float)
        rad/s.
    acceleration : float
        rad/s^2.
    settle_s : float
    """

    rates: tuple = (2.0 * DEG, 2.0 * DEG)
    acceleration: float = 1.0 * DEG
    settle_s: float = 3.0

    def seconds(self, mount, here, there):
        """Duration of a slew.

        Parameters
        ----------
        mount : Mount
        here : (float, float)
            Axis angles, rad.
        there : (ndarray, ndarray), shape (n,)

        Returns
        -------
        ndarray, shape (n,)
        """
        ways = (mount.way(here[0], np.asarray(there[0], float)),
                np.asarray(there[1], float) - here[1])
        longest = 0.0
        for way, rate in zip(ways, self.rates):
            way = np.abs(way)
            ramp = rate**2 / self.acceleration  # distance to accelerate and brake
            longest = np.maximum(longest, np.where(
                way < ramp, 2.0 * np.sqrt(way / self.acceleration),
                way / rate + rate / self.acceleration))
        return longest + self.settle_s


@dataclass(frozen=True)
class NextStar:
    """A chosen star.

    Attributes
    ----------
    row : int
        Row of the candidates.
    seconds : float
        Seconds of slew and exposure.
    before, after : float
        Radial RMS over the places that matter at its end, without it and with it, rad.
    gains : dict of str to float
        Relative decrease of each term's variance, the largest first.
    """

    row: int
    seconds: float
    before: float
    after: float
    gains: dict

    def sentence(self):
        """Reason for the choice, for people."""
        terms = ', '.join(f'{name} {100 * gain:.0f} %' for name, gain in
                         list(self.gains.items())[:3] if gain > 0.05)
        return (f'{self.seconds:.0f} s: reduces the expected error from '
                f'{self.before / ARCSEC:.2f} to {self.after / ARCSEC:.2f} arcsec'
                + (f'; measures {terms} of the variance' if terms else ''))


def next_star(tracker, az, el, here, everywhere, waited=0.0, *, sigma, exposure_s=10.0, slew=None,
              allowed=None):
    """The star with the largest decrease of the error per time.

    Parameters
    ----------
    tracker : Tracker
    az, el : ndarray, shape (n,)
        Candidates in the axes of the mount, rad.
    here : (float, float)
        Present axis angles, rad.
    everywhere : (ndarray, ndarray), shape (p,)
        Places where the pointing matters, rad.
    waited : float
        Seconds since the last observation.
    sigma : float or ndarray, shape (n,)
        1 sigma of each star in x and y, rad.
    exposure_s : float
        Including readout and centring.
    slew : SlewTime, optional
    allowed : ndarray of bool, shape (n,), optional
        Above the horizon, within limits, away from the Sun; by default all.

    Returns
    -------
    NextStar

    Raises
    ------
    ValueError
        No candidate is allowed.
    """
    az, el = (np.asarray(v, float) for v in (az, el))
    rows = np.flatnonzero(np.ones(len(az), bool) if allowed is None else allowed)
    if not len(rows):
        raise ValueError('no star that may be looked at: all candidates are below the horizon, '
                         'beyond limits, or near the Sun')
    seconds = (slew or SlewTime()).seconds(tracker.mount, here, (az[rows], el[rows])) + exposure_s
    noise = np.broadcast_to(np.asarray(sigma, float), len(az))[rows] ** 2
    covariance = tracker.ahead(waited + float(np.median(seconds)))
    places = tracker.columns(*everywhere)
    weight = np.einsum('pij,pik->jk', places, places) / len(places)
    columns = tracker.columns(az[rows], el[rows])
    gains = covariance @ columns.swapaxes(1, 2)  # (n, k, 2)
    inverse = np.linalg.inv(columns @ gains + noise[:, None, None] * np.eye(2))
    less = np.einsum('aki,aij,alj,kl->a', gains, inverse, gains, weight)
    best = int(np.argmax(less / seconds))
    before = float(np.sum(covariance * weight))
    fallen = np.einsum('ki,ij,kj->k', gains[best], inverse[best], gains[best])
    variance = np.diag(covariance)
    part = np.divide(fallen, variance, out=np.zeros_like(fallen), where=variance > 0.0)
    return NextStar(int(rows[best]), float(seconds[best]), float(np.sqrt(before)),
                  float(np.sqrt(max(before - less[best], 0.0))),
                  {tracker.states[k]: float(part[k]) for k in np.argsort(-part)})


def error_over(tracker, everywhere, seconds_ahead=0.0):
    """Expected radial RMS over some places after some time, rad.

    Parameters
    ----------
    tracker : Tracker
    everywhere : (ndarray, ndarray), shape (p,)
        rad.
    seconds_ahead : float
        Seconds since the last observation.
    """
    return rms(tracker.expected(*everywhere, seconds_ahead).radial)


def until(tracker, everywhere, goal, most_s=7200.0):
    """Time for which the pointing stays better than a goal without another star.

    Parameters
    ----------
    tracker, everywhere
        See `error_over`.
    goal : float
        Radial RMS, rad.
    most_s : float

    Returns
    -------
    float
        Seconds since the last observation; 0 if it is worse already, at most `most_s`.
    """
    low, high = 0.0, most_s
    if error_over(tracker, everywhere, low) >= goal:
        return 0.0
    if error_over(tracker, everywhere, high) <= goal:
        return most_s
    while high - low > 1.0:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if error_over(tracker, everywhere, middle) < goal else (
            low, middle)
    return low
