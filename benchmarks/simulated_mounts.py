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

"""Nights of the simulated mounts, only geometry and camera: are the terms recovered, are undeclared
effects identified?

    python benchmarks/simulated_mounts.py [--nights N] [--stars N] [--full] [--verbose]

The simulator's rotations and its camera (1" of noise, with scale and rotation errors) measure
catalogue stars that an uncorrected mount misses by arcminutes. Encoders are perfect, except for the
worm of `german_worm`, so that only the mount is tested. The readings that would have centred the
stars form a run, which is fitted and diagnosed like any other. A German mount observes the east
through its pole, and near the meridian from either side. `--full` runs 100 nights of each scenario
(some minutes of CPU).
"""

import argparse
from dataclasses import replace

import numpy as np

from calibration.analysis.diagnosis.diagnosis import diagnose
from calibration.analysis.term_fit import fit_terms
from encoder_sim.incremental import IncrementalEncoder
from encoder_sim.mount_geometry import MountGeometry
from encoder_sim.scenario_file import load_scenario, scenario_files, undeclared
from encoder_sim.star_camera import Camera
from msg_tools.units import ARCSEC, DEG
from pointing_model.effects import declared_graduation
from pointing_model.mounts import centred, through_pole
from pointing_model.runs.run import PointingRun
from pointing_model.sky.places import observed_place
from pointing_model.sky.star_catalogue import load_catalogue

START = 1_768_482_000  # 2026-01-15 13:00 UTC
#: s from one star to the next, and from its first exposure to the one that counts
STEP, NEXT = 90, 10.0
LOWEST, LIMIT = 20.0 * DEG, 5.0 * DEG
#: from the pole of the first axis, where that axis is too fast; how far the mount points aside
NEAREST, BLIND, ASIDE = 5.0 * DEG, 200.0 * ARCSEC, 30.0 * ARCSEC

PLAIN = ('fork', 'german', 'alt_alt')
UNDECLARED = ('fork_flexure', 'german_counterweight', 'german_flop', 'german_declination_flexure')


def night(scenario, seed, stars=60):
    """A run of stars that the camera has measured.

    Parameters
    ----------
    scenario : encoder_sim.scenario.Scenario
    seed : int
        Of stars, pointings and the camera's noise.
    stars : int
        At most: where there is none in the field none is measured.

    Returns
    -------
    PointingRun
    """
    rng, catalogue = np.random.default_rng(seed), load_catalogue(4.5)
    camera = Camera(scenario, seed, start=START)
    mount = scenario.mount.at(camera.site.latitude)
    made = MountGeometry(scenario.mount, START, seed, camera.site.latitude)
    time = START + STEP * np.arange(stars)
    chosen, beyond = [], []
    for moment in time:
        az, el = observed_place(catalogue, moment, camera.site, camera.weather)
        first, second = mount.axes_of(az, el)
        good = (el > LOWEST) & (np.abs(second) < 90.0 * DEG - NEAREST)
        # as much of the sky everywhere: a direction, and the star that is nearest to it
        a, e = rng.uniform(0.0, 2.0 * np.pi), np.arcsin(rng.uniform(np.sin(LOWEST), 1.0))
        near = mount.direction(first, second).T @ mount.direction(*mount.axes_of(a, e))
        star = int(np.argmax(np.where(good, near, -2.0)))
        chosen.append(star)
        beyond.append(mount.side_for(first[star], second[star], LIMIT, rng.random() < 0.5))
    beyond = np.array(beyond)

    def place(numbers, moments):
        az, el = observed_place(catalogue.select(numbers), moments, camera.site, camera.weather)
        return np.array(mount.on_travel(*through_pole(*mount.axes_of(az, el), beyond)))

    number = {hip: i for i, hip in enumerate(catalogue.hip.tolist())}

    def exposed(moments, reading):
        """What was seen, its place, and the reading that would have centred it."""
        seen = camera.expose((moments * 1e9).astype(np.int64), made.frames(*reading, time=moments))
        # the brightest of the field is the one that was pointed at, or another of the catalogue
        known = np.array([hip in number for hip in seen.hip.tolist()])
        at = place(np.array([number.get(hip, 0) for hip in seen.hip.tolist()]), moments)
        return seen, known, at, np.array(centred(*reading, *seen.miss.T, beyond))

    time = time.astype(float)
    blind = place(np.array(chosen), time)
    aside = np.array([1.0 / np.cos(blind[1]), np.ones(stars)])
    blind += rng.normal(scale=BLIND, size=blind.shape) * aside
    _, found, _, reading = exposed(time, blind)
    # then nearer, as an observer does: how the field is turned is known to the mount's errors
    reading = np.where(found, reading + place(np.array(chosen), time + NEXT)
                       - place(np.array(chosen), time), blind)
    # and aside, for a star in the middle has nothing but noise to tell of the camera
    reading += rng.normal(scale=ASIDE, size=blind.shape) * aside
    seen, known, (az, el), (az_enc, el_enc) = exposed(time + NEXT, reading)
    columns = {'az': az, 'el': el, 'az_enc': az_enc, 'el_enc': el_enc, 'time': time + NEXT,
               'magnitude': seen.mag, 'miss_x': seen.miss[:, 0], 'miss_y': seen.miss[:, 1]}
    return PointingRun(columns, {'mount': mount}).select(known)


def terms_of_truth(scenario):
    """The declared terms in the mount's own names, rad: what a fit should find."""
    return {name: sign * getattr(scenario.mount, own.lower())
            for name, (own, sign) in scenario.mount.names.terms.items()}


def deviations(run, scenario):
    """(found - true) / sigma of each term, and the RMS residual, arcsec."""
    fit = fit_terms(run)
    truth = terms_of_truth(scenario)
    z = [(fit.model.terms[name] - truth[name]) / sigma
         for name, sigma in zip(fit.names, np.sqrt(np.diag(fit.covariance)))]
    return np.array(z), fit.rms_arcsec().radial


def on_its_worm(run, scenario):
    """The run as an encoder on the worm of the first axis reads it, and its teeth declared."""
    params = replace(scenario.incremental.azimuth, pulse_time=0.0)
    encoder = IncrementalEncoder(params, 1, 'hour_angle')
    # past the mark first; what homing leaves in the reading is a zero
    angles = np.concatenate(([params.mark_angle - 0.1, params.mark_angle + 0.1], run['az_enc']))
    reading = encoder.feed(START * 10**9 + 10**10 * np.arange(len(angles)), angles)[2:]
    return PointingRun({**run.columns, 'az_enc': reading}, {
        **run.meta, 'graduation': declared_graduation(
            f'ha.grating={params.worm_teeth}')})


def named(result, wanted):
    """Whether one of the wanted effects leads, and whether it is among those that do as well."""
    if not result.effects:
        return False, False
    first = result.effects[0]
    shown = {first.fitted.effect.name, *first.alternatives, *first.aliases}
    return (any(first.fitted.effect.name.startswith(name) for name in wanted),
            any(name.startswith(start) for name in shown for start in wanted))


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n\n')[0])
    parser.add_argument('--nights', type=int, default=0, help='of each scenario (4)')
    parser.add_argument('--stars', type=int, default=60, help='of a night (60)')
    parser.add_argument('--full', action='store_true', help='100 nights')
    parser.add_argument('--verbose', action='store_true', help='what was named instead')
    args = parser.parse_args()
    nights = args.nights or (100 if args.full else 4)
    print(f'{"what":66s} {"figure":>24s}  {"target":>10s}')

    def row(what, figure, target='', good=None):
        mark = '' if good is None else ('ok' if good else 'MISSED')
        print(f'{what:66s} {figure:>24s}  {target:>10s}  {mark}', flush=True)

    for name in PLAIN:
        scenario = load_scenario(name)
        runs = [night(scenario, seed, args.stars) for seed in range(1, nights + 1)]
        z, left = zip(*(deviations(run, scenario) for run in runs))
        z = np.array(z)
        inside = np.mean(np.abs(z) < 3.0)
        row(f'{name}: {z.size} terms within 3 sigma; their rms in sigma',
            f'{100.0 * inside:.1f} %; {np.sqrt(np.mean(z**2)):.2f}', '>= 98 %; 1', inside >= 0.98)
        row(f'{name}: left of {np.mean([len(run) for run in runs]):.0f} stars, radial',
            f'{np.mean(left):.2f}"', '1.41"')
        alarms = sum(bool(diagnose(run, cross_validation=False, seed=i).effects)
                     for i, run in enumerate(runs))
        row(f'{name}: nights with an effect that is not there', f'{alarms} of {nights}', '1 %')
    for name in UNDECLARED:
        wanted = undeclared(scenario_files(name)[0]['text'])['shows_as']
        scenario, leads, shown = load_scenario(name), 0, 0
        for seed in range(1, nights + 1):
            result = diagnose(night(scenario, seed, args.stars), cross_validation=False, seed=seed)
            one, either = named(result, wanted)
            leads, shown = leads + one, shown + either
            if args.verbose and not one:
                print('    ', seed, [x.fitted.effect.name for x in result.effects],
                      [x.alternatives for x in result.effects])
        row(f'{name}: {" or ".join(wanted)} leads; in the set',
            f'{leads}; {shown} of {nights}', '>= 95 %', shown >= 0.95 * nights)
    scenario, told, untold = load_scenario('german_worm'), 0, 0
    for seed in range(1, nights + 1):
        run = on_its_worm(night(scenario, seed, args.stars), scenario)
        result = diagnose(run, cross_validation=False, seed=seed)
        told += named(result, ['hour_angle_periodic_error_180'])[0]
        del run.meta['graduation']
        result = diagnose(run, cross_validation=False, seed=seed)
        untold += named(result, ['hour_angle_periodic_error_180'])[0]
    row('german_worm: its teeth declared, named', f'{told} of {nights}', '>= 95 %',
        told >= 0.95 * nights)
    row('german_worm: not declared, its period found', f'{untold} of {nights}', '>= 95 %',
        untold >= 0.95 * nights)


if __name__ == '__main__':
    main()
