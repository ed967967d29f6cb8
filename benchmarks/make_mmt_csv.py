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

"""Make ``calibration/data/mmt_2021-08-21.csv`` from the raw night that pytelpoint publishes.

Usage: python benchmarks/make_mmt_csv.py FOLDER_WITH_point_20210821.dat OUT.csv

Prints the difference of the refracted places in the file from ERFA's, which identifies the columns
and confirms the date.
"""

import csv
import sys
from decimal import Decimal
from pathlib import Path

import erfa
import numpy as np

from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.runs.formats.csv import iso_utc
from pointing_model.runs.run import COLUMNS
from pointing_model.sky.earth import earth_orientation

DATE = (2021, 8, 21)  # UTC, from the header of k_and_e.dat; confirmed below
LATITUDE, LONGITUDE, HEIGHT = '31:41:19.6', '-110:53:04.4', 2608.0
PRESSURE, TEMPERATURE, HUMIDITY, WAVELENGTH = 741.0, 13.0, 0.75, 0.55
K_AND_E = Decimal('-5.9') / 3600  # deg, what k_and_e.dat adds to the mount's elevation


def sexagesimal(text):
    """Degrees or hours of d:m:s."""
    sign = -1.0 if text.startswith('-') else 1.0
    return sign * sum(abs(float(v)) / 60.0**i for i, v in enumerate(text.split(':')))


def records(path):
    """One dict per star: tag -> list of words."""
    for part in path.read_text().split('CAT:')[1:]:
        lines = ('CAT:' + part).splitlines()
        yield {tag: rest.split() for tag, _, rest in (line.partition(':') for line in lines)}


def utc_of_sidereal(lst, day):
    """UTC (s since 1970) in the first half of `day` at which the apparent LST is `lst` (rad)."""
    jd = erfa.cal2jd(*day)
    midnight = (sum(jd) - 2440587.5) * 86400.0
    dut1 = earth_orientation(midnight + 18000.0).dut1
    fraction = np.full(len(lst), 0.25)
    for _ in range(5):
        tt = fraction + 69.184 / 86400.0
        gst = erfa.gst06a(jd[0], jd[1] + fraction + dut1 / 86400.0, jd[0], jd[1] + tt)
        late = wrap(lst - gst - sexagesimal(LONGITUDE) * DEG)
        fraction = fraction + late / (2.0 * np.pi) / 1.00273790935
    return midnight + fraction * 86400.0, jd, fraction, dut1


def place(stars, jd, fraction, dut1):
    """Observed azimuth and elevation (rad) by ERFA."""
    words = [star['CAT'] for star in stars]
    ra = np.array([sexagesimal(w[1]) for w in words]) * 15.0 * DEG
    dec = np.array([sexagesimal(w[2]) for w in words]) * DEG
    # per century, seconds of time and arcsec
    pm_ra = np.array([float(w[3]) for w in words]) * 15.0 * ARCSEC / 100.0
    pm_dec = np.array([float(w[4]) for w in words]) * ARCSEC / 100.0
    az, zenith, *_ = erfa.atco13(
        ra, dec, pm_ra, pm_dec, 0.0, 0.0, jd[0], jd[1] + fraction, dut1,
        sexagesimal(LONGITUDE) * DEG, sexagesimal(LATITUDE) * DEG, HEIGHT, 0.0, 0.0,
        PRESSURE, TEMPERATURE, HUMIDITY, WAVELENGTH)
    return az, np.pi / 2.0 - zenith


def main(folder, out):
    stars = list(records(Path(folder) / 'point_20210821.dat'))
    lst = np.array([sexagesimal(star['LST'][0]) for star in stars]) * 15.0 * DEG
    for day in ((2021, 8, 20), DATE, (2021, 8, 22)):
        time, *when = utc_of_sidereal(lst, day)
        az, el = place(stars, *when)
        for tag in ('RAA', 'TAA'):
            theirs = np.array([star[tag] for star in stars], float) * DEG
            x = wrap(theirs[:, 1] - az) * np.cos(el) / ARCSEC
            y = (theirs[:, 0] - el) / ARCSEC
            if tag == 'RAA':
                same = np.hypot(x, y) < 60.0
            # clock, pole and diurnal aberration aside, only the right date leaves nothing
            columns = np.stack([np.cos(el), np.sin(az) * np.sin(el), np.cos(az) * np.sin(el),
                                np.cos(az)], axis=1)[same]
            left = x[same] - columns @ np.linalg.lstsq(columns, x[same], rcond=None)[0]
            print(f'{day} {tag} from ERFA: median |x| {np.median(np.abs(x)):.2f}", '
                  f'|y| {np.median(np.abs(y)):.2f}", x after four terms {left.std():.3f}"')
        if day == DATE:
            utc, known = time, same
            print(f'{(~same).sum()} of {len(stars)} stars were not the one in their CAT line')
    names = ['time', 'star', 'az', 'el', 'az_enc', 'el_enc', 'az_abs', 'el_abs', 'magnitude']
    with open(out, 'w', newline='') as stream:
        writer = csv.writer(stream, lineterminator='\n')
        writer.writerow([COLUMNS[name][0] for name in names])
        for star, stamp, sure in zip(stars, iso_utc(np.round(utc, 3)), known):
            catalogue, (raa_el, raa_az) = star['CAT'], star['RAA']
            taa_el, taa_az = star['TAA']
            abs_el, abs_az = star['ABS_AA']
            taa_el = round(Decimal(taa_el) + K_AND_E, 10)
            writer.writerow([
                stamp[:23] + 'Z', catalogue[0] if sure else 'unknown', raa_az, raa_el, taa_az,
                taa_el, abs_az, abs_el, catalogue[5] if sure else ''])


if __name__ == '__main__':
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
