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

"""Adaptive pointing model compared with the truth and with simpler methods.

    python benchmarks/tracking.py [--nights N] [--only PART] [--full]

Parts: ``errors`` (mean radial true error between the stars, compared with (a) the evening's model,
(b) a refit of all stars so far, (c) a filter that knows rates and jump times, (d) both zeros reset
on the last star; its innovations; its expected error), ``jumps``, ``other`` (nights that violate
the filter's assumptions), ``speed``. `--full`: 200 nights of each rate, 1000 quiet nights.

Nights of 8 h with a star every 10 minutes anywhere above 20 degrees. The tilt drifts a fifth as
fast as the zeros; evening models have 40 stars. The noise of a star is 1.0" in each of x and y, as
for the project's simulated camera; `--noise` sets another, `--sky elevation` other places.
"""

import argparse
import pickle
import time
from collections import Counter

import numpy as np
import tracking_nights
from tracking_nights import BASE, NAMES, PLACES, K, Night, Truth, sky

from calibration.analysis.tracking.innovations import OVER
from calibration.analysis.tracking.motion_causes import ABSOLUTE, INCREMENTAL, TUBE
from calibration.analysis.tracking.tracker import Tracker
from msg_tools.units import ARCSEC

LIMITS = {'a': 0.25, 'b': 0.35, 'c': 1.05}
LIMIT_D = {10: 0.75, 5: 0.55, 2: 0.45}


def follow(night, expect=False, noise=None):
    """Run a tracker through a night: terms before each star, what it heard, RMS expected."""
    tracker = Tracker(night.model(), 0)
    terms, heard, expected = [], [], []
    where = sky(np.random.default_rng(5), PLACES)
    sigma = night.truth.noise if noise is None else noise
    for k in range(night.count):
        terms.append(np.array([tracker.terms()[0][name] for name in NAMES]) - BASE)
        if expect:
            # in the middle of the stretch to the next star, as the truth is looked at along it
            ahead = 3600.0 * night.truth.every * (np.arange(4) + 1) / 4.0
            expected.append(np.mean([np.mean(tracker.expected(*where, s).radial ** 2)
                                     for s in ahead]))
        heard.append(tracker.star(night.stamps[k], night.az[k], night.el[k], *night.offsets[k],
                                  sigma))
    return np.array(terms), heard, np.array(expected), tracker


def quiet(night):
    """Mask of stars not affected by a jump or the recovery from it, shape (stars,)."""
    number = np.arange(night.count)
    good = ~night.is_wrong
    if night.jump_star is not None:
        good &= (number < night.jump_star) | (number > night.jump_star + 1)
    return good


def thirds(values, by):
    """Mean of values in each third of another."""
    edges = np.quantile(by, (0, 1 / 3, 2 / 3, 1))
    place = np.clip(np.searchsorted(edges, by, side='right') - 1, 0, 2)
    return [float(np.mean(values[place == i])) for i in range(3)]


def gather(nights, expect=True):
    """NIS / 2 of all stars with elevation and hour, and error expected and true, squared."""
    rows, errors, verdicts = [], {key: [] for key in 'fabcd'}, []
    for night in nights:
        terms, heard, expected, tracker = follow(night, expect)
        good = quiet(night)
        mean, square = night.errors(terms)
        errors['f'].append(mean.mean())
        for key, other in night.others().items():
            errors[key].append(night.errors(other)[0].mean())
        nis = np.array([h.nis / 2.0 for h in heard])
        if not expect:
            expected = np.full(night.count, np.nan)
        rows.append(np.array([nis, night.el, night.hours, expected, square])[:, good])
        verdicts.append({'over' if h.consistency['verdict']['verdict'] == OVER else 'under'
                         for h in heard if h.consistency})
    return np.concatenate(rows, axis=1), {k: np.mean(v) for k, v in errors.items()}, verdicts


def say_errors(count, noise):
    """The first and the third row of the table, and the error that is expected."""
    pooled = []
    for rate in (10, 5, 2):
        rng = np.random.default_rng(1000 + rate)
        nights = [Night(Truth(rate * ARCSEC, noise=noise * ARCSEC, jump=(
            rng.uniform(0.5, 7.5) if i % 3 == 0 else None)), rng) for i in range(count)]
        rows, errors, verdicts = gather(nights)
        print(f'\n{rate}"/h^.5, star noise {noise}" an axis, {count} nights: mean radial error '
              f'{errors["f"] / ARCSEC:.2f}"')
        for key, words in (('a', 'model of the evening'), ('b', 'refit of all stars so far'),
                           ('c', 'knows rates and jumps'), ('d', 'zeros reset on last star')):
            limit = LIMITS.get(key, LIMIT_D[rate])
            print(f'  of ({key}) {words:26} {errors[key] / ARCSEC:7.2f}"  ratio '
                  f'{errors["f"] / errors[key]:.3f}  (<= {limit})')
        nis, el, hours, expected, square = rows
        pooled.append(rows)
        print(f'  NIS {nis.mean():.3f}; thirds of elevation '
              + ' '.join(f'{v:.2f}' for v in thirds(nis, el)) + '; of time '
              + ' '.join(f'{v:.2f}' for v in thirds(nis, hours)))
        ratios = [e / s for e, s in zip(thirds(expected, hours), thirds(square, hours))]
        print(f'  error expected^2 / true^2: {expected.mean() / square.mean():.2f}; thirds of time '
              + ' '.join(f'{v:.2f}' for v in ratios))
        print('  called over-confident {} nights, under-confident {}'.format(
            *(sum(word in v for v in verdicts) for word in ('over', 'under'))))
    nis, el, hours = np.concatenate(pooled, axis=1)[:3]
    print(f'\nall three: NIS {nis.mean():.3f} (0.95 to 1.05); thirds of elevation '
          + ' '.join(f'{v:.2f}' for v in thirds(nis, el)) + '; of time '
          + ' '.join(f'{v:.2f}' for v in thirds(nis, hours)) + ' (0.90 to 1.10)')


def jumped(night, rng, who=None):
    """A night that jumps by 7 to 14 sigma of the predicted difference: star, axis, and what is
    called: (star, what jumped).

    `who` is one of `WHO` where both encoders are read.
    """
    at, axis = int(rng.integers(6, night.count - 4)), int(rng.integers(2))
    # two good stars: else it is not the second that could tell
    night.is_wrong[at:at + 2] = False
    night.offsets[at:at + 2] = [clean(night, k, rng) for k in (at, at + 1)]
    tracker = Tracker(night.model(), 0, sensors=['difference'] if who else ())
    size, called = 0.0, []
    star, shown = WHO[who] if who else (1.0, 0.0)
    for k in range(night.count):
        if k == at:
            ahead = tracker.expected(night.az[k], night.el[k], 3600 * night.truth.every)
            sigma = np.sqrt(ahead.covariance[0, axis, axis] + night.truth.noise**2)
            size = rng.uniform(7.0, 14.0) * sigma * rng.choice([-1, 1])
            size /= night.columns[k][axis, axis]
        for one in (0, 1) if who else ():
            # the walk of the zeros is the incremental encoder's
            difference = (-night.path[k, -1, one] + rng.normal() * 0.3 * ARCSEC
                          + shown * size * (one == axis))
            called += [(k, s) for s in tracker.difference(
                night.stamps[k], one, difference, 0.3 * ARCSEC).events]
        off = night.offsets[k] + star * size * night.columns[k][:, axis]
        called += [(k, s) for s in tracker.star(
            night.stamps[k], night.az[k], night.el[k], *off, night.truth.noise).events]
    return at, axis, [(k, found.causes[0]) for k, found in called if found.kind == 'jump']


WHO = {INCREMENTAL: (1.0, -1.0), ABSOLUTE: (0.0, 1.0), TUBE: (1.0, 0.0)}


def say_jumps(count, quiet_nights, noise):
    """The second row."""
    for rate in (5, 2):
        rng = np.random.default_rng(2000 + rate)

        def night(rate=rate, rng=rng):
            return Night(Truth(rate * ARCSEC, noise=noise * ARCSEC, wrong=0.02), rng)

        in_time = right = 0
        for _ in range(count):
            at, axis, called = jumped(night(), rng)
            called = [(k, s) for k, s in called if k >= at]
            in_time += bool(called) and called[0][0] <= at + 1
            right += bool(called) and called[0][1].startswith(('azimuth', 'elevation')[axis])
        print(f'\n{rate}"/h^.5, 2 % wrong stars: jumps of 7 to 14 sigma called by the second star '
              f'{in_time} of {count} ({100 * in_time / count:.1f} %, >= 95), axis right {right} '
              f'({100 * right / count:.1f} %, >= 95)')
        in_time, right = Counter(), Counter()
        for i in range(count):
            who = tuple(WHO)[i % 3]
            at, axis, called = jumped(night(), rng, who)
            called = [(k, s) for k, s in called if k >= at]
            in_time[who] += bool(called) and called[0][0] <= at + 1
            right[who] += bool(called) and called[0][1].startswith(
                f'{who}, {("azimuth", "elevation")[axis]}')
        print('  with both encoders, called in time and the right one named, of '
              f'{(count + 2) // 3}: ' + ', '.join(
                  f'{who} {in_time[who]}, {right[who]}' for who in WHO) + ' (>= 95 %)')
        false = called = wrongs = 0
        for _ in range(quiet_nights):
            one = night()
            said = [s for heard in follow(one)[1] for s in heard.events]
            false += sum(found.kind == 'jump' for found in said)
            called += sum(found.kind == 'wrong star' for found in said)
            wrongs += int(one.is_wrong.sum())
        print(f'  false jumps in {quiet_nights} quiet nights: {false}, '
              f'{false / quiet_nights:.4f} a night (<= 0.03); {wrongs} wrong stars, '
              f'{called} stars called wrong')


def clean(night, k, rng):
    """The offset of a star that is not a wrong one."""
    from pointing_model.model import PointingModel
    model = PointingModel(dict(zip(NAMES, BASE + night.path[k, -1])))
    return np.array(model.offsets(night.az[k], night.el[k])) + rng.normal(
        size=2) * night.truth.noise


OTHERS = (('random walk, white noise', {}), ('noise AR(1) 0.6', {'colour': 'ar1'}),
          ('noise t(4)', {'colour': 't4'}), ('zeros that settle', {'drift': 'settling'}),
          ('zeros that swing in the hour', {'drift': 'sine'}),
          ('rate a third, then thrice', {'drift': 'changing'}))


def say_other(count, noise):
    """Nights that violate the filter's assumptions, and wrongly specified star noise."""
    print(f'\n5"/h^.5, {count} nights each: NIS, thirds of time; expected^2 / true^2; of (a), (d); '
          'nights called over-, under-confident')
    for words, how in OTHERS:
        rng = np.random.default_rng(77)
        nights = [Night(Truth(5 * ARCSEC, noise=noise * ARCSEC, **how), rng)
                  for _ in range(count)]
        (nis, _, hours, expected, square), errors, verdicts = gather(nights)
        over, under = (sum(w in v for v in verdicts) for w in ('over', 'under'))
        print(f'  {words:30} {nis.mean():5.2f} ' + ' '.join(f'{v:5.2f}' for v in
                                                          thirds(nis, hours))
              + f'   {expected.mean() / square.mean():.2f}   {errors["f"] / errors["a"]:.2f} '
              f'{errors["f"] / errors["d"]:.2f}   {over:3d} {under:3d}')
    for factor in (0.5, 2.0):
        rng, called, error, last = np.random.default_rng(78), 0, [], []
        for _ in range(count):
            night = Night(Truth(5 * ARCSEC, noise=noise * ARCSEC), rng)
            terms, heard, _, tracker = follow(night, noise=factor * noise * ARCSEC)
            called += any(h.consistency is not None for h in heard)
            known = night.errors(night.others()['c'])[0].mean()
            error.append(night.errors(terms)[0].mean() / known)
            last += [h.nis / 2.0 for h in heard[-16:]]
        print(f'  star noise given {factor} times as large: called in {called} of {count} nights; '
              f'error {np.mean(error):.3f} of (c); NIS of the last third {np.mean(last):.2f}')


def say_speed(count):
    """The last row: a night's mean, by the clock of this process."""
    rng, took, size = np.random.default_rng(5), [], []
    for i in range(count):
        night = Night(Truth((10, 5, 2)[i % 3] * ARCSEC, wrong=0.02,
                            jump=4.0 if i % 3 == 0 else None), rng)
        tracker = Tracker(night.model(), 0)
        for k in range(night.count):
            begin = time.process_time()
            tracker.star(night.stamps[k], night.az[k], night.el[k], *night.offsets[k], ARCSEC)
            took.append(time.process_time() - begin)
            size.append(len(pickle.dumps(tracker)) if k % 16 == 15 else 0)
    night = size[-night.count:]
    print(f'\none update with {K} terms and {len(tracker.facts)} rates: mean '
          f'{1e3 * np.mean(took):.2f} ms, 99 % {1e3 * np.quantile(took, 0.99):.2f} ms (<= 1); '
          f'state {night[15] // 1024} kB after 16 stars, {night[-1] // 1024} kB after {len(night)}')


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--nights', type=int, default=12)
    parser.add_argument('--noise', type=float, default=1.0, help='of a star, arcsec an axis')
    parser.add_argument('--sky', choices=('area', 'elevation'), default='area',
                        help='stars and places alike all over the sky, or in elevation')
    parser.add_argument('--only', choices=('errors', 'jumps', 'other', 'speed'))
    parser.add_argument('--full', action='store_true')
    options = parser.parse_args()
    tracking_nights.DRAWN = options.sky
    count = 200 if options.full else options.nights
    parts = {'errors': lambda: say_errors(count, options.noise),
             'jumps': lambda: say_jumps(count, 1000 if options.full else 2 * count, options.noise),
             'other': lambda: say_other(100 if options.full else count, options.noise),
             'speed': lambda: say_speed(6)}
    for name, part in parts.items():
        if options.only in (None, name):
            part()


if __name__ == '__main__':
    main()
