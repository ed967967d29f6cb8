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

"""Many nights without ROS: error of the zero from Polaris, and the encoder cross-check.

    python benchmarks/zero_drift.py --nights 1000 --faults 200
    python benchmarks/zero_drift.py --causes       # causes of jumps: see `jump_causes`
    python benchmarks/zero_drift.py --quiet        # false alarms, also of noise that is not white
    python benchmarks/zero_drift.py --causes --quiet --full    # 500 nights of each, 1000 quiet

Two nights per seed, with a power-on each: 30 stars, 16 exposures of Polaris, 30 stars, star noise
1" per axis. Mount, incremental encoder (scenario `default`: 20" of drift per power-on) and homing
are those of `encoder_sim`; the absolute encoder has the errors of its disc, drift and reading
noise. The first night is the reference for the second, in which the faults happen.
"""

import argparse
import dataclasses
import time
from collections import Counter

import numpy as np

from calibration.analysis.encoders.cross_check import Homing, cross_check
from calibration.analysis.term_fit import fit_terms
from calibration.analysis.zero.power_on_zeros import zero_from_exposures
from calibration.report.wording import wording
from encoder_sim import keyed_noise
from encoder_sim.encoder_scale import ZeroDrift
from encoder_sim.graduated_disc import disc_angle
from encoder_sim.incremental import IncrementalEncoder
from encoder_sim.mount import HOME_ATTEMPTS, SimulatedMount
from encoder_sim.mount_geometry import MountGeometry, azimuth_elevation
from encoder_sim.scenario_file import load_scenario
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.runs.run import PointingRun
from pointing_model.sky.star_catalogue import POLARIS_HIP

AXES = ('azimuth', 'elevation')
STARS, EXPOSURES, PACE = 30, 16, 14.0
START, DAY = 1_768_482_000.0, 86400.0
LATITUDE, POLAR_DISTANCE, SIDEREAL = 34.3 * DEG, 0.63 * DEG, 2.0 * np.pi / 86164.1
ABSOLUTE_NOISE = 0.33 * ARCSEC  # of the template reading


def polaris(times):
    """Azimuth and elevation of a star near the pole."""
    angle = SIDEREAL * times
    az = POLAR_DISTANCE * np.sin(angle) / np.cos(LATITUDE)
    return az, LATITUDE + POLAR_DISTANCE * np.cos(angle)


def sky(times, seed):
    """Targets of a night: azimuth, elevation, star number."""
    rng = np.random.default_rng(seed)
    n = len(times)
    az = rng.uniform(0.0, 2.0 * np.pi, n)
    el = np.arcsin(rng.uniform(np.sin(20 * DEG), np.sin(85 * DEG), n))
    star = rng.integers(20_000, 100_000, n)
    pole = slice(STARS, STARS + EXPOSURES)
    az[pole], el[pole] = polaris(times[pole])
    star[pole] = POLARIS_HIP
    return az, el, star


def axes_on(geometry, az, el, **where):
    """Axis angles that put the boresight on the star."""
    angles = np.array([az, el])
    for _ in range(4):
        found = np.array(azimuth_elevation(geometry.boresight(*angles, **where)))
        angles = angles + np.array([wrap(az - found[0]), el - found[1]])
    return angles


class Night:
    """A night of the scenario's mount, with encoder readings."""

    absolute_noise = ABSOLUTE_NOISE

    def __init__(self, scenario, seed, number):
        self.scenario, self.seed = scenario, seed
        self.start = START + number * DAY
        self.encoders = [
            IncrementalEncoder(getattr(scenario.incremental, axis), seed, axis, number + 1,
                               start=self.start) for axis in AXES]
        self.number = self.run = 2 * number + 1
        self.homings = []

    def home(self, at):
        """Home, slower if necessary; False if the marks are not found."""
        mount, begin = SimulatedMount(self.scenario), at - self.start
        for attempt in range(HOME_ATTEMPTS):
            first, last = mount.home(begin, attempt)
            moments = np.append(np.linspace(first, last, 5), last + 2.0)
            angles = mount.truth(moments)[0]
            stamps = np.rint((self.start + moments) * 1e9).astype(np.int64)
            readings = [encoder.feed(stamps, angle)[-1]
                        for encoder, angle in zip(self.encoders, angles.T)]
            begin = last + 3.0
            if not mount.home_failure(readings, attempt):
                break
        for axis, encoder in zip(AXES, self.encoders):
            s = encoder.homing
            self.homings.append(Homing(self.run, axis, s.homed, s.side, s.missed_marks,
                                       s.mark_error, encoder.count_angle,
                                       encoder.params.pulse_width))
        return bool(np.isfinite(readings).all())

    def observe(self):
        """The night's rows; none if homing fails."""
        if not self.home(self.start):
            return None
        times = self.start + 30.0 + PACE * np.arange(2 * STARS + EXPOSURES)
        az, el, star = sky(times, (self.seed, self.number))
        warmth = self.scenario.temperature(times, self.start)
        geometry = MountGeometry(self.scenario.mount, self.start)
        angles = axes_on(geometry, az, el, time=times, temperature=warmth)
        stamps = np.rint(times * 1e9).astype(np.int64)
        enc, run = np.empty((2, len(times))), np.empty(len(times))
        for k in range(len(times)):
            for _ in range(2):
                enc[:, k] = [encoder.feed(stamps[k], angle, temperature=warmth[k])[0]
                             for encoder, angle in zip(self.encoders, angles[:, k])]
                if np.isfinite(enc[:, k]).all():
                    break
                self.run += 1
                self.home(times[k] - 0.9 * PACE)
                stamps[k] += 10**9
            run[k] = self.run
        noise = self.scenario.camera.star_noise * keyed_noise.normal(
            self.seed, 'camera', 'star', stamps, 2).T
        noise[0] /= np.cos(el)
        second = self.absolute(stamps, angles, warmth)
        return PointingRun({
            'time': times, 'run': run, 'star': star, 'az': az, 'el': el,
            **dict(zip(('az_enc', 'el_enc'), enc + noise)),
            **dict(zip(('az_abs', 'el_abs'), second + noise))})

    def absolute(self, stamps, angles, warmth):
        """The absolute encoders' readings, by their error model."""
        out = []
        for axis, angle in zip(AXES, angles):
            p, device = getattr(self.scenario.absolute, axis), f'absolute/{axis}'
            zero = ZeroDrift(p, self.seed, device)
            shown = disc_angle(angle, p.eccentricity, p.eccentricity_phase, 0.5 * p.diameter)
            out.append(shown + p.zero_offset + zero.at_power_on((self.number + 1) // 2)
                       + zero.later(stamps * 1e-9 - self.start, warmth)
                       + self.absolute_noise * keyed_noise.normal(self.seed, device, 'noise',
                                                                  stamps))
        return np.array(out)


def changed(scenario, path, **values):
    """The scenario with other values in a section, by its dotted path (SI)."""
    name, _, rest = path.partition('.')
    inner = getattr(scenario, name)
    inner = changed(inner, rest, **values) if rest else dataclasses.replace(inner, **values)
    return dataclasses.replace(scenario, **{name: inner})


def faults():
    """Name -> (scenario of the second night, cause that must be named, axis)."""
    default = load_scenario('default')
    slipped = default.absolute.elevation.zero_offset + 6 * ARCSEC
    return {
        'no fault': (default, '', ''),
        'mark missed': (load_scenario('mark_missed'), 'incremental', 'azimuth'),
        'wrong side': (load_scenario('wrong_side'), 'incremental', 'azimuth'),
        'temperature step': (load_scenario('temperature_step'), 'incremental', 'azimuth'),
        'power failure': (load_scenario('power_failure'), 'incremental', 'azimuth'),
        'lost counts': (load_scenario('lost_counts'), 'incremental', 'elevation'),
        'absolute encoder slips 6"': (
            changed(default, 'absolute.elevation', zero_offset=slipped), 'absolute', 'elevation'),
        'mount leans 8" to the north': (
            changed(default, 'mount', an=default.mount.an + 8 * ARCSEC), 'mount', 'elevation'),
        'absolute encoder drifts 10"/h': (
            changed(default, 'absolute.azimuth', zero_rate=10 * ARCSEC / 3600.0), 'absolute',
            'azimuth'),
    }


def one(reference_scenario, scenario, seed, with_zero):
    """(report, pulls and errors of the zero by Polaris and by the absolute encoder)."""
    before, now = Night(reference_scenario, seed, 0), Night(scenario, seed, 1)
    earlier, rows = before.observe(), now.observe()
    model = fit_terms(earlier).model
    if rows is None:
        nothing = earlier.select(slice(0, 0))
        return cross_check(nothing, earlier, model=model, homings=now.homings), None
    report = cross_check(rows, earlier, model=model, homings=now.homings)
    if not with_zero:
        return report, None
    then = earlier.select(earlier['star'] == POLARIS_HIP)
    exposures = rows.select(rows['star'] == POLARIS_HIP)
    zero = zero_from_exposures(exposures, then, model=model)
    true = [b.zero - a.zero for a, b in zip(before.encoders, now.encoders)]
    return report, [(zero.az - true[0], zero.sigma_az), (zero.el - true[1], zero.sigma_el)]


def print_zero(figures):
    """Bias and spread of the zero."""
    values = np.array(figures) / ARCSEC  # (nights, axis, (error, sigma))
    print(f'{"zero by Polaris - true":24} {"bias":>8} {"+-":>6} {"spread":>8} {"sigma":>8} '
          f'{"ratio":>6}   arcsec')
    for axis, (error, sigma) in zip(AXES, np.moveaxis(values, (1, 2), (0, 1))):
        spread, predicted = error.std(ddof=1), np.sqrt(np.mean(sigma**2))
        print(f'{axis:24} {error.mean():+8.3f} {spread / np.sqrt(len(error)):6.3f} {spread:8.3f} '
              f'{predicted:8.3f} {spread / predicted:6.3f}')


def main():
    """Simulate, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--nights', type=int, default=1000)
    parser.add_argument('--faults', type=int, default=200, help='nights with each fault')
    parser.add_argument('--first', type=int, default=1)
    parser.add_argument('--only', default='', help='one fault, by the beginning of its name')
    parser.add_argument('--show', action='store_true', help='print the alarms of the first nights')
    parser.add_argument('--causes', type=int, default=0, nargs='?', const=20, metavar='NIGHTS',
                        help='instead: so many nights with a jump of each cause')
    parser.add_argument('--quiet', type=int, default=0, nargs='?', const=20, metavar='NIGHTS',
                        help='instead: so many quiet nights of each kind of noise')
    parser.add_argument('--full', action='store_true',
                        help='--causes with 500 nights, --quiet with 1000')
    args = parser.parse_args()
    if args.causes or args.quiet:
        import jump_causes
        if args.causes:
            jump_causes.print_causes(500 if args.full else args.causes, args.first)
        if args.quiet:
            jump_causes.print_quiet(1000 if args.full else args.quiet, args.first)
        return
    default = load_scenario('default')
    rows = []
    for name, (scenario, who, axis) in faults().items():
        if not name.startswith(args.only):
            continue
        count = args.nights if not who else args.faults
        began = time.process_time()
        raised = named = agree = 0
        kinds, figures = Counter(), []
        for seed in range(args.first, args.first + count):
            report, zero = one(default, scenario, seed, not who)
            alarms = [wording(found) for found in report.alarms]
            raised += bool(alarms)
            named += any(line.startswith(f'{axis}: {who}') for line in alarms)
            agree += all(abs(change.pull) <= 3.0 for change in report.shifts)
            kinds.update(' '.join(line.split()[:3]) for line in alarms)
            if zero:
                figures.append(zero)
            if args.show and seed < args.first + 3:
                print('\n'.join([name, *alarms, *map(wording, report.notes)]))
        if figures:
            print_zero(figures)
        rows.append((name, count, raised, named if who else None, agree, kinds,
                     (time.process_time() - began) / count))
    print(f'\n{"fault":30} {"nights":>6} {"alarm":>7} {"named":>7} {"agree 3s":>8} {"CPU ms":>7}')
    for name, count, raised, named, agree, kinds, took in rows:
        right = '' if named is None else f'{named / count:7.1%}'
        print(f'{name:30} {count:6} {raised / count:7.2%} {right:>7} {agree / count:8.1%} '
              f'{took * 1e3:7.0f}  {dict(kinds.most_common(4))}')


if __name__ == '__main__':
    main()
