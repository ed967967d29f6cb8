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

"""Polar alignment: measure misaligned mounts, turn their bolts as recommended, repeat.

    python benchmarks/bolts.py [--mounts N] [--rows N] [--noise ARCSEC] [--first-order]

A mount is a base with an azimuth bolt, about its own vertical, and an altitude bolt, about a hinge
carried by the first. It carries the axes of `encoder_sim`, with zeros, cone error,
non-perpendicular axes and tube flexure. A round is a run of plate solves on both pier sides, a fit
of the seven terms, and a turn of both bolts by the result. Printed is the distance of the axis from
the pole after each round, compared with 10" and three standard errors of the last fit.
"""

import argparse
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from calibration.analysis.term_fit import fit_terms
from encoder_sim.mount_geometry import MountErrors, MountGeometry
from msg_tools.units import ARCSEC, DEG
from pointing_model.bolts_and_feet import polar_axis
from pointing_model.mounts import Mount, is_beyond
from pointing_model.runs.run import PointingRun

LATITUDES = -65.0, -33.0, -10.0, 5.0, 28.0, 48.0, 60.0, 70.0
UP = np.array([0.0, 0.0, 1.0])


@dataclass
class Bolted:
    """An equatorial mount on its bolts.

    Attributes
    ----------
    latitude : float
        rad.
    kind : {'german', 'equatorial'}
    vertical : ndarray, shape (3,)
        About which the bolt in azimuth turns it, east north up.
    errors : dict of str to float
        Of its axes and tube, for `MountErrors`, rad.
    """

    latitude: float
    kind: str
    vertical: np.ndarray
    errors: dict

    def __post_init__(self):
        self.mount = Mount.equatorial(self.latitude, self.kind)
        sag = self.errors.pop('tf', 0.0)
        self._tube = MountGeometry(MountErrors(kind=self.kind, **self.errors),
                                   latitude=self.latitude)
        self._sag = MountGeometry(MountErrors(tf=sag))
        self.base = Rotation.from_rotvec(np.cross(UP, self.vertical))
        self.hinge = self.base.apply([1.0, 0.0, 0.0])

    def turn_azimuth(self, angle):
        """Turn the base clockwise, seen from above, rad."""
        turn = Rotation.from_rotvec(-angle * self.vertical)
        self.base, self.hinge = turn * self.base, turn.apply(self.hinge)

    def raise_axis(self, angle):
        """Turn the end of the axis that is in the sky up, rad."""
        # right-handed about east what lies in the north goes up
        sign = 1.0 if self.latitude >= 0.0 else -1.0
        self.base = Rotation.from_rotvec(sign * angle * self.hinge) * self.base

    def off(self):
        """Angle from axis to pole, rad."""
        pole = np.array(self.mount.frame[2])
        return float(2.0 * np.arcsin(0.5 * np.linalg.norm(self.base.apply(pole) - pole)))

    def looks(self, first, second):
        """Pointing directions (east, north, up) at given readings, shape (n, 3)."""
        seen = self.base.apply(self._tube.boresight(first, second))
        low = np.arctan2(seen[:, 0], seen[:, 1]), np.arcsin(seen[:, 2])
        return self._sag.boresight(*low)

    def run(self, rows, noise, rng):
        """Plate solves all over the sky, above 15 degrees."""
        first = rng.uniform(0.0, np.pi, 40 * rows)
        beyond = rng.random(40 * rows) < 0.5
        if self.kind != 'german':
            first, beyond = rng.uniform(-np.pi, np.pi, 40 * rows), np.zeros(40 * rows, bool)
        second = np.arcsin(rng.uniform(-1.0, np.sin(80 * DEG), 40 * rows))
        if self.latitude < 0.0:
            second = -second
        second = np.where(beyond, np.pi - second, second)
        seen = self.looks(first, second)
        up = np.flatnonzero(seen[:, 2] > np.sin(15 * DEG))[:rows]
        first, second, seen = first[up], second[up], seen[up]
        az, el = np.arctan2(seen[:, 0], seen[:, 1]), np.arcsin(seen[:, 2])
        place = self.mount.on_travel(*self.mount.axes_of(az, el, is_beyond(second)))
        x, y = rng.normal(0.0, noise, (2, len(up)))
        return PointingRun({'az': place[0], 'el': place[1], 'el_enc': second + y,
                            'az_enc': first + x / np.cos(second)}, {'mount': self.mount})


def turned(model, bolted, first_order=False):
    """Turn both bolts as the model says, or by MA / cos(latitude) and ME; the axis before."""
    axis = polar_axis(model)
    if first_order:
        bolted.turn_azimuth(model.terms['MA'] / np.cos(bolted.latitude))
        bolted.raise_axis(-model.terms['ME'] * (1.0 if bolted.latitude > 0.0 else -1.0))
    else:
        bolted.turn_azimuth(-axis.azimuth_error)
        bolted.raise_axis(-axis.altitude_error)
    return axis


def made(rng, latitude, kind, off, unlevel):
    """A mount off by up to `off` on a base off level by `unlevel`, rad."""
    toward = rng.uniform(0.0, 2.0 * np.pi)
    level = np.array([np.sin(unlevel) * np.cos(toward), np.sin(unlevel) * np.sin(toward),
                      np.cos(unlevel)])
    errors = dict(zip(('ia', 'ie', 'ca', 'npae', 'tf'), rng.normal(0.0, 300.0 * ARCSEC, 5)))
    errors['tf'] = abs(errors['tf']) / 10.0
    out = Bolted(latitude, kind, level, errors)
    size, way = off * np.sqrt(rng.uniform(0.0, 1.0)), rng.uniform(0.0, 2.0 * np.pi)
    out.turn_azimuth(size * np.cos(way) / np.cos(latitude))
    out.raise_axis(size * np.sin(way))
    return out


def rounds(rng, latitude, kind='german', off=5.0 * DEG, unlevel=0.0, count=3, rows=40,
           noise=2.0 * ARCSEC, first_order=False):
    """Distance of an axis from the pole before and after each round, and sigma of each fit.

    Returns
    -------
    off, sigma : ndarray, shape (count + 1,), (count,)
        rad.
    """
    bolted = made(rng, latitude, kind, off, unlevel)
    apart, sigmas = [bolted.off()], []
    for _ in range(count):
        fitted = fit_terms(bolted.run(rows, noise, rng), bolted.mount.names.physical).model
        axis = turned(fitted, bolted, first_order)
        variance = axis.covariance * np.outer(*2 * [[np.cos(bolted.latitude), 1.0]])
        sigmas.append(np.sqrt(np.trace(variance)))
        apart.append(bolted.off())
    return np.array(apart), np.array(sigmas)


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--mounts', type=int, default=10, help='of each latitude and kind')
    parser.add_argument('--rows', type=int, default=40)
    parser.add_argument('--noise', type=float, default=2.0, help='arcsec, an axis')
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--first-order', action='store_true', help='turn by MA / cos(latitude)')
    args = parser.parse_args()
    print('largest angle from axis to pole, arcsec\n'
          f'{"latitude":>8s} {"base":>10s} {"mounts":>6s}  '
          + ' '.join(f'{f"{k} rounds":>12s}' for k in range(4))
          + f' {"sigma":>12s}  beyond 10" + 3 sigma')
    for unlevel, judged in ((0.0, 2), (1.0 * DEG, 3)):
        for latitude in LATITUDES:
            rng = np.random.default_rng([args.seed, int(latitude) + 90, judged])
            done = [rounds(rng, latitude * DEG, kind, unlevel=unlevel, rows=args.rows,
                           noise=args.noise * ARCSEC, first_order=args.first_order)
                    for kind in ('german', 'equatorial') for _ in range(args.mounts)]
            apart, sigma = (np.array(v) / ARCSEC for v in zip(*done))
            over = np.sum(apart[:, judged] > 10.0 + 3.0 * sigma[:, judged - 1])
            print(f'{latitude:8.0f} {"level" if not unlevel else "1 deg off":>10s} '
                  f'{len(done):6d}  ' + ' '.join(f'{v:12.1f}' for v in apart.max(axis=0))
                  + f' {np.median(sigma):12.2f}  {over} of {len(done)}', flush=True)


if __name__ == '__main__':
    main()
