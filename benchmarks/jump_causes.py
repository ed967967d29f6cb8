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

"""Encoder cross-check: how often is the cause of a jump named, how often are there false alarms?

    python benchmarks/zero_drift.py --causes 100
    python benchmarks/zero_drift.py --quiet 100

Nights of `zero_drift`, but encoder zeros change at a power-on by only 0.3", as is usual for the
absolute one. In addition there is a jump: of the incremental encoder, of the absolute one, of both
(differing by the same number of sigma of their difference), or of the mount about the axis. It
happens at the power-on, by `zero_drifts_arcsec` of the encoders, or during the night at an unknown
moment, 20 rows or more from its ends.

One sigma is that of a zero measured on the sky. At a power-on: the night-to-night noise of absolute
encoder - sky, and the usual changes of 0.5". In the night: the sigma of a step at that moment in a
fit with moment and noise known. `night to night` uses the night-to-night noise for a step in the
night too: 152 rows determine the difference of the encoders better than the 76 of one night, so
these jumps have only 3.5 to 4 sigma.

Each figure is compared with two peers that know the noise. `moment known` decides like the
calibration, but knows the moment: no detector with as few single-encoder jumps wrongly named "both"
names more. `beyond chance` must also exceed the significance level of the calibration
(`Budget.false_alarm`), corrected for the search over all moments of the night.
"""

import time
from collections import Counter

import numpy as np
from scipy.special import ndtri
from zero_drift import ABSOLUTE_NOISE, AXES, Night, changed, load_scenario

from calibration.analysis.encoders.cross_check import cross_check
from calibration.analysis.encoders.cross_check_rows import (
    ABSOLUTE,
    ALIKE,
    BOTH,
    INCREMENTAL,
    USUAL,
    CrossCheckNight,
)
from calibration.analysis.term_fit import fit_terms
from calibration.report.wording import wording
from msg_tools.units import ARCSEC

CAUSES = (INCREMENTAL, ABSOLUTE, BOTH, ALIKE)
STAR_NOISE = load_scenario('default').camera.star_noise
#: of an encoder at a power-on
USUAL_MOVE = 0.3 * ARCSEC
RHO = 0.6


# --- a jump ---------------------------------------------------------------------------------------


def quiet(seed):
    """The default scenario with small zero changes at a power-on for both encoders.

    Returns the scenario and the changes of the zeros, {encoder: (2,)}, of the second night, rad.
    """
    rng = np.random.default_rng([seed, 2])
    return load_scenario('default'), {
        name: USUAL_MOVE * rng.normal(size=2) for name in ('incremental', 'absolute')}


def with_zeros(scenario, zeros):
    """The scenario with these changes of the zeros at the second power-on."""
    for name, values in zeros.items():
        for axis, value in zip(AXES, values):
            scenario = changed(scenario, f'{name}.{axis}', zero_drift=0.0,
                               zero_drifts=(0.0, float(value)))
    return scenario


def pair(seed, axis, jump):
    """Two nights, with a jump of an axis's zeros, or of the mount, at the second power-on."""
    scenario, zeros = quiet(seed)
    before = with_zeros(scenario, {name: np.zeros(2) for name in zeros})
    for name, value in zip(('incremental', 'absolute'), jump):
        zeros[name][axis] += value
    after = with_zeros(scenario, zeros)
    term = ('ia', 'ie')[axis]
    after = changed(after, 'mount', **{term: getattr(after.mount, term) + jump[2]})
    return Night(before, seed, 0).observe(), Night(after, seed, 1).observe()


def jumps(cause, absolute, difference, sigmas, rng):
    """Jump by `cause` of `sigmas` sigma: (incremental, absolute, mount), rad."""
    size = rng.choice([-1.0, 1.0]) * sigmas * absolute
    if cause == BOTH:
        # against each other, or to one side by as many sigma of their difference
        if rng.random() < 0.5:
            return size, -size, 0.0
        return size + np.sign(size) * sigmas * difference, size, 0.0
    return tuple(size * (cause == one) for one in (INCREMENTAL, ABSOLUTE, ALIKE))


class Known:
    """Peer that knows the moment of a jump and the noise.

    Parameters
    ----------
    covariance : ndarray, shape (2, 2)
        Of incremental - absolute and absolute - sky, rad^2.
    """

    toll = 2.576  # two-sided 1 %, as `Budget.second`
    #: (incremental - absolute, absolute - sky) of 1 rad by a cause
    ratios = {INCREMENTAL: (1.0, 0.0), ABSOLUTE: (-1.0, 1.0), ALIKE: (0.0, 1.0)}

    def __init__(self, covariance):
        self.inverse = np.linalg.inv(covariance)
        self.sigma = np.sqrt(np.diag(covariance))

    def best(self, sizes):
        """The cause, decided as in the calibration, and the size of the jump in sigma."""
        sizes = np.asarray(sizes)
        gains = {BOTH: sizes @ self.inverse @ sizes - self.toll**2}
        for name, ratio in self.ratios.items():
            gains[name] = (ratio @ self.inverse @ sizes) ** 2 / (ratio @ self.inverse @ ratio)
        return max(gains, key=gains.get), np.sqrt(gains[BOTH] + self.toll**2)


def inside(rows, model, axis, since):
    """Fitted sizes of a step at a row in both differences, and the `Known` for it."""
    night = CrossCheckNight(rows, None)
    sky = night.sky([], model, [])
    column = np.where(np.arange(len(rows)) >= since, 1.0, 0.0)
    difference, difference_sigma = last(
        night.difference_design(axis), column, night.difference[axis],
        np.full(len(rows), ABSOLUTE_NOISE))
    # the incremental encoder reads (all but) without noise: its difference from the sky has none
    # in common with that from the absolute one
    first, first_sigma = last(sky.design, night.on_sky(axis, column), sky.incremental,
                              np.full(2 * len(rows), STAR_NOISE))
    shared = difference_sigma**2
    return (difference, first - difference), Known(np.array(
        [[shared, -shared], [-shared, shared + first_sigma**2]]))


def last(base, column, y, noise):
    """The last coefficient of a fit with this noise, and its sigma."""
    inverse = np.linalg.pinv(np.column_stack([np.asarray(base).T, column]) / noise[:, None], 1e-9)
    return float(inverse[-1] @ (y / noise)), float(np.linalg.norm(inverse[-1]))


def one_jump(cause, when, sigmas, night_to_night, seed):
    """Causes named by the calibration and the two peers for one jump; whether there is an alarm."""
    rng = np.random.default_rng([seed, 3])
    axis = int(rng.integers(2))
    noise, usual = night_to_night
    nothing = (0.0, 0.0, 0.0)
    if when == 'power-on':
        jump = jumps(cause, *usual[axis], sigmas, rng) if cause else nothing
        earlier, rows = pair(seed, axis, jump)
        report = cross_check(rows, earlier, model=fit_terms(earlier).model)
        change = report.shifts[axis]
        moves = USUAL_MOVE**2 * np.array([[2.0, -1.0], [-1.0, 1.0]])
        known = Known(moves + np.diag(noise[axis, ::-1] ** 2))
        sizes, searched = (change.difference, change.absolute), 1
        said = change.cause
    else:
        earlier, rows = pair(seed, axis, nothing)
        model = fit_terms(earlier).model
        since = int(rng.integers(20, len(rows) - 20))
        _, known = inside(rows, model, axis, since)
        unit = known.sigma[::-1] if when == 'in the night' else noise[axis]
        jump = jumps(cause, *unit, sigmas, rng) if cause else nothing
        for encoder, value in zip(('enc', 'abs'), jump):
            rows[f'{("az", "el")[axis]}_{encoder}'][since:] += value + jump[2]
        sizes, _ = inside(rows, model, axis, since)
        searched = len(rows) - 9
        report = cross_check(rows, earlier, model=model)
        found = [event.moved if event.kind == 'step' else event.kind
                 for event in report.events if event.axis == AXES[axis]]
        said = found[0] if len(found) == 1 else f'{len(found)} events'
    peer, by = known.best(sizes)
    beyond = peer == cause and (
        when == 'power-on' and cause == INCREMENTAL  # expected there
        or by > -ndtri(0.25 * USUAL.false_alarm / searched))
    return said, peer, cause if beyond else '-', bool(report.alarms)


def night_to_night(first, count=20):
    """1 sigma of absolute - sky and of incremental - absolute, (axis, 2), rad.

    Median of nights without a jump: the noise alone, and with the usual changes of the encoders.
    """
    found = []
    for seed in range(first, first + count):
        earlier, rows = pair(seed, 0, (0.0, 0.0, 0.0))
        changes = cross_check(rows, earlier, model=fit_terms(earlier).model).shifts
        found.append([[c.absolute_sigma, c.difference_sigma] for c in changes])
    noise = np.median(found, axis=0)
    return noise, np.hypot(noise, USUAL.absolute * np.sqrt([1.0, 2.0]))


def print_causes(count, first):
    """A table: jump by, when, of how many sigma, how often it is named."""
    sigma = night_to_night(first)
    for name, rows in zip(('noise', 'and what is usual'), sigma):
        for axis, (absolute, difference) in zip(AXES, rows / ARCSEC):
            print(f'1 sigma from night to night, {name}, {axis}: absolute encoder - sky '
                  f'{absolute:.2f}", incremental - absolute {difference:.2f}"')
    print(f'{"jump of":20} {"when":15} {"sigma":>5} {"nights":>6} {"right":>7} {"moment":>7} '
          f'{"beyond":>7} {"alarm":>7}\n{"":57} {"known":>7} {"chance":>7}  target 95 %')
    for when in ('power-on', 'in the night', 'night to night'):
        for cause in ('', *CAUSES):
            for low, high in ((0.0, 0.0),) if not cause else ((5.0, 5.0), (5.0, 15.0)):
                if when == 'night to night' and not cause:
                    continue
                _row(cause, when, low, high, sigma, range(first, first + count))


def _row(cause, when, low, high, sigma, seeds):
    said, right, alarms = Counter(), np.zeros(3), 0
    for seed in seeds:
        sigmas = np.random.default_rng([seed, 4]).uniform(low, high)
        *names, alarm = one_jump(cause, when, sigmas, sigma, seed)
        said[names[0]] += 1
        right += [name == cause for name in names]
        alarms += alarm
    right /= len(seeds)
    if not cause:
        right[0] = sum(said[name] for name in ('nothing', '0 events')) / len(seeds)
    peers = ' '.join(f'{value:7.1%}' if cause else f'{"":7}' for value in right[1:])
    sizes = f'{low:g}' if low == high else f'{low:g}-{high:g}'
    print(f'{cause or "nothing":20} {when:15} {sizes:>5} {len(seeds):6} {right[0]:7.1%} {peers} '
          f'{alarms / len(seeds):7.1%}  {dict(said.most_common(4))}', flush=True)


# --- quiet nights ---------------------------------------------------------------------------------


class OtherNoise(Night):
    """A night with AR(1) noise of coefficient `RHO`.

    Parameters
    ----------
    of : {'stars', 'differences', 'both'}
    """

    def __init__(self, of, *args):
        super().__init__(*args)
        self.of = of
        if of != 'stars':
            self.absolute_noise = 0.0
        if of != 'differences':
            self.scenario = changed(self.scenario, 'camera', star_noise=0.0)

    def observe(self):
        rows = super().observe()
        rng = np.random.default_rng([self.seed, self.number, 5])
        cos_el = np.array([np.cos(rows['el']), np.ones(len(rows))])
        seen = STAR_NOISE * ar1(rng, len(rows)) / cos_el * (self.of != 'differences')
        own = ABSOLUTE_NOISE * ar1(rng, len(rows)) * (self.of != 'stars')
        for axis, short in enumerate(('az', 'el')):
            rows[f'{short}_enc'][:] += seen[axis]
            rows[f'{short}_abs'][:] += seen[axis] + own[axis]
        return rows


def ar1(rng, n):
    """Two series, shape (2, n), of variance 1."""
    out = rng.normal(size=(2, n))
    for k in range(1, n):
        out[:, k] = RHO * out[:, k - 1] + np.sqrt(1.0 - RHO**2) * out[:, k]
    return out


class Discs(Night):
    """A night whose discs are off their axes (once a turn) and tilted (twice)."""

    def observe(self):
        rows = super().observe()
        rng = np.random.default_rng([self.seed, 6])  # the same on all nights
        for encoder, sizes in (('enc', (5.0, 2.0)), ('abs', (3.0, 1.0))):
            for short in ('az', 'el'):
                phases = rng.uniform(0.0, 2.0 * np.pi, 2)
                for k, (size, phase) in enumerate(zip(sizes, phases), 1):
                    rows[f'{short}_{encoder}'][:] += size * ARCSEC * np.cos(k * rows[short] - phase)
        return rows


def kinds():
    """Name -> (a night from scenario, seed and number; changes of the scenario)."""
    counts = load_scenario('wandering_counts').incremental.elevation.miscounts
    out = {f'{of} AR(1) {RHO:g}': (lambda *a, of=of: OtherNoise(of, *a), None)
           for of in ('stars', 'differences', 'both')}
    return {'white': (Night, None), **out, 'discs 1 and 2 a turn': (Discs, None),
            'counts wander (elevation)': (Night, counts)}


def print_quiet(count, first):
    """False alarms, by the kind of noise. Of counts that wander all that is said of another."""
    print(f'{"quiet nights":28} {"nights":>6} {"false alarms":>14} {"walk told":>9} {"CPU ms":>7}'
          '  target 1 %')
    for name, (night, counts) in kinds().items():
        scenario, began = load_scenario('default'), time.process_time()
        if counts is not None:
            scenario = changed(scenario, 'incremental.elevation', miscounts=counts)
        said, false, walks = Counter(), 0, 0
        for seed in range(first, first + count):
            earlier, rows = (night(scenario, seed, k).observe() for k in (0, 1))
            report = cross_check(rows, earlier, model=fit_terms(earlier).model)
            alarms = [wording(found) for found in report.alarms]
            if counts is not None:
                own = [line for line in alarms if line.startswith(f'elevation: {INCREMENTAL}')]
                walks += any('drift against' in line for line in own)
                alarms = [line for line in alarms if line not in own]
            false += bool(alarms)
            said.update(' '.join(line.split()[:5]) for line in alarms)
        walked = '' if counts is None else f'{walks / count:.1%}'
        print(f'{name:28} {count:6} {f"{false} ({false / count:.2%})":>14} {walked:>9} '
              f'{(time.process_time() - began) / count * 1e3:7.0f}  {dict(said.most_common(4))}',
              flush=True)
