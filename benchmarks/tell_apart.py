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

"""Ambiguous causes of a short run, distinguished by additional, specifically requested stars.

    python benchmarks/tell_apart.py [--nights N] [--stars N] [--hours H] [--full] [--seed N]
                                    [--only NAME ...]

Sixteen mounts with one effect each, by independent formulas. The first run has 20 stars, 80 s
apart, 1" of noise per axis, and an effect large enough to be detected but not identified; only runs
with the verdict `ambiguous` count. Then stars are requested, and the nearest catalogue star is
observed (within about 2 degrees), until one cause is left or no further star can decide. For
comparison, the same number of stars anywhere on the sky, evaluated in the same way after each. If
the result is "cannot be told from here", observation continues to the last star: if a cause is then
identified, the search was given up too early.
"""

import argparse

import numpy as np
from diagnosis_nights import _aberration, _terms_of, make_run, on_az, on_el, scaled

from calibration.analysis.diagnosis.diagnosis import diagnose
from calibration.analysis.diagnosis.discrimination import (
    CANNOT,
    MOST_STARS,
    ONE_CAUSE,
    Discrimination,
)
from calibration.estimation.false_alarms import ALPHA
from calibration.report.wording import wording
from msg_tools.units import ARCSEC, DEG, wrap

START, EACH = 1.7e9 - 9.0 * 3600.0, 80.0  # s: night for hours
U = ARCSEC
FIRST = 20
ALL = 20.0, 85.0
LIMITS = 20.0 * DEG, 85.0 * DEG


def _equatorial_x(c):
    lst = 109.0 * DEG + 4.894961212735793 + 2.0 * np.pi * 1.00273790935 * (
        (c['time'] - 946728000.0) / 86400.0)
    s, k = np.sin(34.3 * DEG), np.cos(34.3 * DEG)
    return np.array([-np.sin(lst), -s * np.cos(lst), k * np.cos(lst)])


#: name of the cause, as the diagnosis calls it -> (offsets of (columns, phase), how the first run
#: goes: elevations in deg; whether it cools evenly)
SCENARIOS = {
    'second_flexure': (lambda c, p: on_el(np.arctan2(
        np.sin(c['el']), np.cos(c['el']) - U) - c['el']), ALL, False),
    'elevation_encoder_3': (lambda c, p: on_el(U * np.sin(3.0 * c['el'] + p)), ALL, False),
    'refraction': (lambda c, p: on_el(
        U / np.tan(c['el'] + 7.31 * DEG / (c['el'] / DEG + 4.4))), (30.0, 85.0), False),
    'azimuth_encoder_2': (lambda c, p: on_az(c, wrap(np.arctan2(
        (1.0 + U) * np.sin(c['az'] - p), np.cos(c['az'] - p)) - c['az'] + p)), (35.0, 60.0), False),
    'azimuth_encoder_4': (lambda c, p: on_az(c, U * np.sin(4.0 * c['az'] + p)), (35.0, 60.0),
                          False),
    'line_of_sight_2': (lambda c, p: np.array([U * np.cos(2.0 * c['az'] + p), 0.0 * c['az']]),
                        (35.0, 60.0), False),
    'elevation_nod_3': (lambda c, p: on_el(U * np.cos(3.0 * c['az'] + p)), (20.0, 50.0), False),
    'azimuth_bearing_wobble_3': (lambda c, p: _terms_of(
        c, AN=U * np.cos(2.0 * c['az'] + p), AW=U * np.sin(2.0 * c['az'] + p)), (20.0, 50.0),
        False),
    'azimuth_hysteresis_cosE': (lambda c, p: on_az(c, U * c['approach_az']), (30.0, 60.0), False),
    'azimuth_hysteresis': (lambda c, p: np.array([U * c['approach_az'], 0.0 * c['az']]),
                           (30.0, 60.0), False),
    'elevation_hysteresis': (lambda c, p: on_el(U * c['approach_el']), (30.0, 60.0), False),
    'elevation_hysteresis_cosE': (lambda c, p: on_el(U * c['approach_el'] * np.cos(c['el'])),
                                  (30.0, 60.0), False),
    'flexure_with_temperature': (lambda c, p: _terms_of(c, TF=U * (c['temperature'] - 9.0)),
                                 (30.0, 60.0), False),
    'elevation_zero_with_temperature': (lambda c, p: on_el(U * (c['temperature'] - 9.0)),
                                        (30.0, 60.0), False),
    'azimuth_zero_with_temperature': (lambda c, p: on_az(c, U * (c['temperature'] - 9.0)),
                                      (35.0, 60.0), True),
    'annual_aberration': (lambda c, p: _aberration(c, U * _equatorial_x(c)), ALL, False),
}


class Night:
    """A mount with one effect, and its rows so far.

    Parameters
    ----------
    name : str
        Of `SCENARIOS`.
    seed : int
    size : float
        |(1 - P) s| / sigma of the effect in the first run.
    """

    def __init__(self, name, seed, size):
        self._effect, self._range, self._even = SCENARIOS[name]
        self._rng = np.random.default_rng([seed, sorted(SCENARIOS).index(name)])
        self._phase = self._rng.uniform(0.0, 2.0 * np.pi)
        self._bumps = self._rng.normal(size=4) * 0.4
        self._rows, self._noise, self._now = [], [], START
        low, high = self._range
        for _ in range(FIRST):
            self._add(*self._anywhere(low, high))
        c = self._columns()
        s = self._effect(c, self._phase)
        made = scaled(c, s, size)
        self.hidden = made is None
        self._factor = 0.0 if self.hidden else float(np.linalg.norm(made) / np.linalg.norm(s))

    def _anywhere(self, low, high):
        return (self._rng.uniform(0.0, 2.0 * np.pi), np.arcsin(
            self._rng.uniform(np.sin(low * DEG), np.sin(high * DEG))), 0, 0)

    def _temperature(self):
        h = (self._now - START) / 3600.0
        if self._even:
            return 12.0 - 3.0 * h + 0.02 * self._rng.normal()
        u = h / 0.5
        return (0.1 * self._rng.normal() + 12.0 - 4.0 * u**0.7
                + self._bumps @ np.sin(np.array([3.0, 7.0, 11.0, 17.0]) * u))

    def _add(self, az, el, side_az, side_el):
        before = self._rows[-1] if self._rows else {'az': 0.0, 'el': 0.0}
        natural = np.sign(wrap(az - before['az'])) or 1.0, np.sign(el - before['el']) or 1.0
        self._now += EACH * self._rng.uniform(0.8, 1.2)
        self._rows.append({
            'az': az % (2.0 * np.pi), 'el': el, 'time': self._now,
            'temperature': self._temperature(),
            'approach_az': side_az or natural[0], 'approach_el': side_el or natural[1],
            'magnitude': self._rng.uniform(1.0, 6.0)})
        self._noise.append(self._rng.normal(size=2))

    def _columns(self):
        return {k: np.array([row[k] for row in self._rows]) for k in self._rows[0]}

    def run(self):
        """All rows."""
        c = self._columns()
        offsets = self._factor * self._effect(c, self._phase) + np.array(self._noise).T
        return make_run(c, *offsets)

    def anywhere(self):
        """Take a star anywhere."""
        self._add(*self._anywhere(*ALL))

    def asked(self, request):
        """Take the star nearest to what is asked for, and one before it where that is asked."""
        self._now += 3600.0 * (request['after_hours'] or 0.0)
        for one in filter(None, (request['before'], request)):
            off = self._rng.normal(size=2) * 2.0 * DEG
            el = np.clip(one['el_deg'] * DEG + off[1], ALL[0] * DEG, ALL[1] * DEG)
            self._add(one['az_deg'] * DEG + off[0] / np.cos(el), el, one['approach_az'],
                      one['approach_el'])


def asked_for(name, seed, size, args, diagnosis, least=None):
    """Stars that are asked for: last judgement, stars taken."""
    night = Night(name, seed, size)
    apart = Discrimination(diagnosis, args.hours, LIMITS,
                  **({} if least is None else {'least_chance': least}))
    while True:
        taken = len(night.run()) - FIRST
        judged = apart.compare(night.run(), args.stars)
        if judged.request is None or taken >= args.stars:
            return judged, taken, night
        night.asked(judged.request)


def anywhere(name, seed, size, args, diagnosis):
    """Stars anywhere, as many."""
    night, apart = Night(name, seed, size), Discrimination(diagnosis, args.hours)
    taken, judged = 0, apart.compare(night.run(), ask=False)
    while taken < args.stars and judged.state != ONE_CAUSE:
        night.anywhere()
        taken, judged = taken + 1, apart.compare(night.run(), ask=False)
    return judged, taken


def is_right(name, judged, bank):
    """Whether the best is the cause, or of its mechanism."""
    best = judged.questions[0].best
    return name == best or bool(bank.get(name)) and bank.get(name) == bank.get(best)


def mechanisms(diagnosis):
    """Of each candidate its mechanism."""
    from calibration.analysis.diagnosis.run_problem import RunProblem
    run = RunProblem(diagnosis.observations, diagnosis.base, ALPHA, curves=False)
    return {e.name: e.mechanism for e in run.problem.dictionary.effects}


def scenario(name, args):
    """A row of the table."""
    seed, sizes = args.seed, (10.0, 14.0)
    out = dict.fromkeys(('nights', 'right', 'wrong', 'cannot', 'left out', 'early', 'more',
                         'open', 'any right', 'any wrong', 'tries', 'outside', 'confirmed'), 0)
    stars, any_stars, sets = [], [], {}
    while out['nights'] < args.nights and out['tries'] < 20 * args.nights:
        seed += 1
        out['tries'] += 1
        size = np.random.default_rng(seed).uniform(*sizes)
        night = Night(name, seed, size)
        if night.hidden:
            continue
        first = diagnose(night.run(), cross_validation=False, seed=seed)
        if first.verdict != 'ambiguous' or len(first.effects) > 1:
            continue
        bank = mechanisms(first)
        members = [first.effects[0].fitted.effect.name, *first.effects[0].other_causes]
        inside = name in members or any(bank.get(m) and bank.get(m) == bank.get(name)
                                        for m in members)
        out['outside'] += not inside
        out['nights'] += 1
        for m in members:
            sets[m] = sets.get(m, 0) + 1
        judged, taken, after = asked_for(name, seed, size, args, first)
        right = is_right(name, judged, bank)
        if judged.state == ONE_CAUSE:
            out['right' if right else 'wrong'] += 1
            stars.append(taken)
            last = diagnose(after.run(), cross_validation=False, seed=seed)
            out['confirmed'] += bool(last.effects) and any(
                e.fitted.effect.name == judged.questions[0].best for e in last.effects)
        elif judged.state == CANNOT:
            out['cannot'] += 1
            q = judged.questions[0]
            out['left out'] += not (right or name in q.stays or any(
                bank.get(m) and bank.get(m) == bank.get(name) for m in q.stays))
            on, _, _ = asked_for(name, seed, size, args, first, -1.0)
            out['early'] += on.state == ONE_CAUSE and is_right(name, on, bank)
            out['more'] += any(one.kind != 'alike on all stars' for one in q.needed.values())
        else:
            out['open'] += 1
        if args.verbose:
            print('   ', seed, round(size, 1), members, taken, right, wording(judged.finding()))
        judged, taken = anywhere(name, seed, size, args, first)
        if judged.state == ONE_CAUSE:
            out['any right' if is_right(name, judged, bank) else 'any wrong'] += 1
            any_stars.append(taken)
    out['stars'] = np.median(stars) if stars else np.nan
    out['any stars'] = np.median(any_stars) if any_stars else np.nan
    out['set'] = sorted(sets, key=lambda m: -sets[m])[:3]
    return out


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--nights', type=int, default=2, help='ambiguous nights of each scenario')
    parser.add_argument('--stars', type=int, default=MOST_STARS)
    parser.add_argument('--hours', type=float, default=2.0, help='that may be waited for a star')
    parser.add_argument('--seed', type=int, default=0, help='of the first night')
    parser.add_argument('--only', nargs='*', default=list(SCENARIOS))
    parser.add_argument('--full', action='store_true', help='25 nights each')
    parser.add_argument('--verbose', action='store_true')
    args = parser.parse_args()
    if args.full:
        args.nights = 25
    print(f'{"cause":33s} nights  asked for: right wrong cannot (too early, cause left out) '
          'open, stars | anywhere: right wrong open, stars')
    total = {}
    for name in args.only:
        o = scenario(name, args)
        for key, value in o.items():
            if isinstance(value, int):
                total[key] = total.get(key, 0) + value
        print(f'{name:33s} {o["nights"]:4d} of {o["tries"]:3d} {o["right"]:5d} {o["wrong"]:5d} '
              f'{o["cannot"]:5d} ({o["early"]}, {o["left out"]}) {o["open"]:5d} {o["stars"]:5.0f} '
              f'| {o["any right"]:5d} {o["any wrong"]:5d} '
              f'{o["nights"] - o["any right"] - o["any wrong"]:5d} {o["any stars"]:5.0f}  '
              f'{", ".join(o["set"])}', flush=True)
    n = max(total['nights'], 1)
    told = total['right'] + total['wrong']
    honest = total['right'] + total['cannot'] - total['early'] - total['left out']
    print(f'all: {total}')
    print(f'one cause, right, or "cannot be told" and it cannot: {100.0 * honest / n:.1f} % of {n} '
          '(target >= 90 %); the same number anywhere: one cause, right: '
          f'{100.0 * total["any right"] / n:.1f} %')
    print(f'one cause, and wrong: {total["wrong"]} of {told}; anywhere {total["any wrong"]} of '
          f'{total["any right"] + total["any wrong"]}')


if __name__ == '__main__':
    main()
