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

"""Precise orbits: interpolation of held-out epochs, places against Skyfield and astropy, speed.

    OMP_NUM_THREADS=1 python benchmarks/orbits.py [--data ../shared/data/orbits] [--rounds 5]

Places: all use the same ITRF positions, Earth orientation and site, without refraction. Compared
are Skyfield's ``altaz`` of the difference (geometric) and its ``apparent`` via the solar system
barycentre, and astropy's AltAz of a topocentric ITRS, at the retarded position rotated with the
Earth, which has no aberration. Peers: extra ``test``.
"""

import argparse
import warnings
from functools import partial
from pathlib import Path

import erfa
import numpy as np
from race import Row, peer, race, show

from msg_tools.units import ARCSEC, DEG
from pointing_model.sky.earth import earth_orientation, split_utc
from pointing_model.sky.elements import Satellite, turned
from pointing_model.sky.orbits.ephemeris import Arc, lagrange
from pointing_model.sky.orbits.orbit_files import Orbits
from pointing_model.sky.refraction import Weather
from pointing_model.sky.satellite_place import Corrections, satellite_place
from pointing_model.sky.site import Site

DATA = Path(__file__).resolve().parent.parent.parent / 'shared' / 'data' / 'orbits'
#: file -> what is in it, limit of the RMS (m)
FILES = {
    'ilrsa.orb.lageos2.160319.v35.sp3.gz': ('LAGEOS-2', 0.002),
    'ESA0OPSRAP_20232390000_01D_15M_ORB.SP3.gz': ('GPS 2023', 0.003),
    'esa11802.eph': ('GPS 2002', 0.006),
    'asi.orb.etalon2.171209.v70.sp3': ('Etalon-2', 0.006)}
_COUNT = 1000
_VACUUM = Weather(pressure_hpa=0.0)
_SITE = Site(34.3 * DEG, 109.0 * DEG, 500.0)


def left_out(arc):
    """Errors (m) of every second epoch interpolated from the others, away from the ends.

    Returns
    -------
    ours, plain : float
        3-D RMS: in axes that do not turn, and in ITRF itself.
    first : float
        Of the second epoch of the file by all others, m.
    """
    half = arc.width // 2
    kept = Arc(arc.origin, arc.epochs[::2], arc.places[::2], None, arc.sigmas[::2], '',
               count=arc.wanted)
    at, truth = arc.epochs[1:-1:2][half:-half], arc.places[1:-1:2][half:-half]
    rms = lambda off: float(np.sqrt(np.mean(np.sum(np.square(off), axis=1))))  # noqa: E731
    plain = lagrange(kept.epochs, kept.places, at, arc.width)
    one = arc.without(1)
    return (rms(kept.itrf(at) - truth), rms(plain - truth),
            rms(one.itrf(arc.epochs[1:2]) - arc.places[1:2]))


def accuracy(data):
    """Lines of the table of held-out epochs."""
    yield f'{"every second epoch left out":28} RMS, m   in ITRF itself   first interval   limit'
    for name, (what, limit) in FILES.items():
        orbits = Orbits([data / name])
        rows = {}
        for one in orbits.names:
            if one[0] in 'GL':
                rows[one] = left_out(orbits.orbit(one).arcs[0])
        bad = [note.split(' of ')[1].split()[0] for note in orbits.notes if 'itself jumps' in note]
        good = np.array([row for one, row in rows.items() if one not in bad])
        total = np.sqrt(np.mean(np.square(good[:, :2]), axis=0))
        yield (f'{what:28} {total[0]:.4f}   {total[1]:.4f}           {good[:, 2].max():.3f}'
               f'            {limit}')
        if len(good) > 1:
            worst = max((one for one in rows if one not in bad), key=lambda one: rows[one][0])
            yield f'  worst of {len(good)}: {worst} {rows[worst][0]:.4f}, ' + (
                'the orbits themselves jump of ' + ', '.join(
                    f'{one} ({rows[one][0]:.3f} m)' for one in bad) if bad else 'none jumps')


class _Peers:
    """Skyfield and astropy for one satellite's ITRF positions."""

    def __init__(self, orbit, time):
        from skyfield import api
        from skyfield.framelib import itrs
        from skyfield.vectorlib import VectorFunction
        data = peer('skyfield_data')
        middle = earth_orientation(float(np.mean(time)))
        self.orientation = middle
        utc = split_utc(time)
        self.tt = erfa.taitt(*erfa.ufunc.utctai(*utc)[:2])
        ut1 = erfa.ufunc.utcut1(*utc, middle.dut1)
        delta_t = ((self.tt[0] - ut1[0]) + (self.tt[1] - ut1[1])) * 86400.0
        self.scale = api.load.timescale(delta_t=float(np.mean(delta_t)))
        self.scale.polar_motion_table = ([0.0], [float(middle.xp) / ARCSEC],
                                         [float(middle.yp) / ARCSEC])
        with warnings.catch_warnings():
            warnings.simplefilter('ignore', RuntimeWarning)
            self.planets = api.Loader(data.get_skyfield_data_path(), verbose=False)('de421.bsp')
        self.place = api.wgs84.latlon(_SITE.latitude / DEG, _SITE.longitude / DEG, _SITE.height)
        begin = float(time[0])

        class Body(VectorFunction):
            """The same orbit in the form that Skyfield needs."""

            center, target = 399, -1

            def _at(self, t):
                late = ((t.whole - self.first[0]) + (t.tt_fraction - self.first[1])) * 86400.0
                place = orbit.itrf(begin, late)
                vectors = np.einsum('ij...,...i->j...', itrs.rotation_at(t), place) / erfa.DAU
                return vectors, 0.0 * vectors, None, None
        self.body = Body()
        one = self.scale.tt_jd(self.tt[0][0], self.tt[1][0])
        Body.first = one.whole, one.tt_fraction

    def moments(self):
        """Skyfield times, newly made so that nothing is cached."""
        return self.scale.tt_jd(*self.tt)

    def geometric(self):
        """Altitude, azimuth, distance."""
        return (self.body - self.place).at(self.moments()).altaz()

    def apparent(self):
        """The same via the barycentre."""
        earth = self.planets['earth']
        return (earth + self.place).at(self.moments()).observe(
            earth + self.body).apparent().altaz()


def _apart(az, el, az2, el2):
    """Largest separation, arcsec."""
    one, two = (np.stack([np.cos(e) * np.sin(a), np.cos(e) * np.cos(a), np.sin(e)])
                for a, e in ((az, el), (az2, el2)))
    return float(np.max(2.0 * np.arcsin(np.linalg.norm(one - two, axis=0) / 2.0)) / ARCSEC)


def _by_astropy(orbit, time):
    """Azimuth and elevation of the retarded position, which the Earth's turn has carried on."""
    from astropy import units
    from astropy.coordinates import ITRS, AltAz, CartesianRepresentation, EarthLocation
    from astropy.time import Time
    from astropy.utils import iers
    iers.conf.auto_download = False
    site = EarthLocation.from_geodetic(_SITE.longitude / DEG, _SITE.latitude / DEG, _SITE.height)
    ground = np.array([site.x.value, site.y.value, site.z.value])
    delay = np.zeros(len(time))
    for _ in range(4):
        place = turned(orbit.itrf(time, -delay), 7.292115e-5 * delay)
        delay = np.linalg.norm(place - ground, axis=1) / erfa.CMPS
    moment = Time(time, format='unix')
    from_here = ITRS(CartesianRepresentation((place - ground).T * units.m), obstime=moment,
                     location=site)
    there = from_here.transform_to(AltAz(obstime=moment, location=site))
    return there.az.rad, there.alt.rad


def places(data, rounds):
    """Lines of the comparison of places, and rows of that of speed."""
    rows = []
    yield f'{"place of " + str(_COUNT) + " epochs, arcsec":36} geometric   apparent   astropy'
    for name, one in (('ilrsa.orb.lageos2.160319.v35.sp3.gz', None), ('esa11802.eph', '28'),
                      ('asi.orb.etalon2.171209.v70.sp3', None)):
        orbit = Orbits([data / name]).orbit(one)
        time = np.floor(orbit.begin + 7200.0 + np.linspace(0.0, 64800.0, _COUNT))
        peers = _Peers(orbit, time) if peer('skyfield') and peer('skyfield_data') else None
        yield f'{orbit.name:36} ' + '   '.join(_compared(orbit, time, peers))
        if peers is not None:
            best = race({'ours': partial(satellite_place, orbit, time, _SITE, _VACUUM),
                         'Skyfield': peers.apparent}, rounds)
            rows.append(Row('orbits', f'places of {orbit.name}', f'{_COUNT}', best['ours'],
                            'Skyfield', best['Skyfield'], 10.0))
            peers.planets.close()
    show(rows)


def _compared(orbit, time, peers):
    """Cells: largest differences of geometric and apparent places, and of astropy's, arcsec."""
    bare = Corrections(light_time=False, diurnal_aberration=False)
    for what, corrections in (('geometric', bare), ('apparent', None)):
        if peers is None:
            yield '-'
            continue
        ours = satellite_place(orbit, time, _SITE, _VACUUM, corrections=corrections)[:2]
        el, az, _ = getattr(peers, what)()
        yield f'{_apart(*ours, az.radians, el.radians):.6f}'
    still = Corrections(diurnal_aberration=False)
    ours = satellite_place(orbit, time, _SITE, _VACUUM, corrections=still)[:2]
    yield f'{_apart(*ours, *_by_astropy(orbit, time)):.2g}' if peer('astropy') else '-'


def fitted_elements(orbit, step=900.0):
    """RMS residuals (m) along, across and radial of SGP4 fitted to a day; arcsec.

    Six mean elements; positions by the same chain as of two-line elements.
    """
    from scipy.optimize import least_squares
    from sgp4.api import WGS72, Satrec

    from pointing_model.sky.earth import DAY, MJD_1970
    time = np.arange(np.ceil(orbit.begin) + 1.0, orbit.end - 1.0, step)
    epoch = time[len(time) // 2]
    truth = orbit.itrf(time)
    day = epoch / DAY + MJD_1970 - 33281.0  # from 1949-12-31, as SGP4 counts

    class Fitted(Satellite):
        """Elements from a vector."""

        record = None

        def __init__(self, p):
            object.__setattr__(self, 'record', Satrec())
            self.record.sgp4init(WGS72, 'i', 1, day, 0.0, 0.0, 0.0, float(np.hypot(p[0], p[1])),
                                 float(np.arctan2(p[1], p[0])), float(p[2]), float(
                                     np.mod(p[3] - np.arctan2(p[1], p[0]), 2.0 * np.pi)),
                                 float(p[4]), float(p[5]))

    def off(p):
        try:
            return ((Fitted(p).itrf(time) - truth) / 1e3).ravel()
        except ValueError:
            return np.full(truth.size, 1e6)
    place = truth[len(time) // 2]
    velocity = (turned(orbit.itrf(epoch + 1.0), -7.292115e-5)
                - turned(orbit.itrf(epoch - 1.0), 7.292115e-5)) / 2.0
    turn = float(erfa.gmst82(*erfa.utcut1(*split_utc(epoch), earth_orientation(epoch).dut1)[:2]))
    p = least_squares(off, _osculating(turned(place, -turn), turned(velocity, -turn)),
                      x_scale=(1e-3, 1e-3, 1e-3, 1e-3, 1e-5, 1e-3)).x
    left = Fitted(p).itrf(time) - truth
    radial = truth / np.linalg.norm(truth, axis=1)[:, None]
    speed = np.gradient(truth, time, axis=0) + 7.292115e-5 * np.stack(
        (-truth[:, 1], truth[:, 0], 0.0 * time), axis=1)
    pole = np.cross(truth, speed)
    pole /= np.linalg.norm(pole, axis=1)[:, None]
    ways = np.cross(pole, radial), pole, radial
    rms = [float(np.sqrt(np.mean(np.sum(left * way, axis=1)**2))) for way in ways]
    return rms, float(np.hypot(*rms[:2]) / 22e6 / ARCSEC)


def _osculating(place, velocity):
    """e cos w, e sin w, inclination, w + M (rad), mean motion (rad/min), node, of a state."""
    gm = 3.986004418e14
    distance, momentum = np.linalg.norm(place), np.cross(place, velocity)
    axis = 1.0 / (2.0 / distance - velocity @ velocity / gm)
    tilt = np.arccos(momentum[2] / np.linalg.norm(momentum))
    node = np.arctan2(momentum[0], -momentum[1])
    along = np.array([np.cos(node), np.sin(node), 0.0])
    across = np.cross(momentum / np.linalg.norm(momentum), along)
    ecc = np.cross(velocity, momentum) / gm - place / distance
    x, y = ecc @ along, ecc @ across
    e, w = np.hypot(x, y), np.arctan2(y, x)
    true = np.arctan2(place @ across, place @ along) - w
    at = 2.0 * np.arctan2(np.sqrt(1.0 - e) * np.sin(true / 2.0), np.sqrt(1.0 + e) * np.cos(
        true / 2.0))
    return np.array([x, y, tilt, w + at - e * np.sin(at), np.sqrt(gm / axis**3) * 60.0, node])


def elements(data):
    """Accuracy of two-line elements for the GPS orbits of 2002-08-20, including the paper's."""
    orbits = Orbits([data / 'esa11802.eph'])
    yield 'SGP4 fitted to a day of a precise orbit, RMS: along, across, out (m); on the sky'
    for name in ('G18', 'G28', 'G31', 'G07'):
        (along, across, out), angle = fitted_elements(orbits.orbit(name))
        yield f'{name:28} {along:.0f} {across:.0f} {out:.0f}   {angle:.2f}"'


def main():
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--data', type=Path, default=DATA)
    parser.add_argument('--rounds', type=int, default=5)
    args = parser.parse_args()
    for line in accuracy(args.data):
        print(line)
    print()
    for line in elements(args.data):
        print(line)
    print()
    for line in places(args.data, args.rounds):
        print(line)


if __name__ == '__main__':
    main()
