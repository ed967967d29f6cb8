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

"""`bolts --live` with images drawn for a simulated mount and a real plate solver.

    python benchmarks/live_bolts.py [--mounts N] [--seed N]

Needs solve-field and its Tycho-2 index files. A mount misaligned by degrees writes images into a
folder (400 x 400 pixels of 60", stars of the Hipparcos catalogue): three with the hour axis turned,
then one after each partial turn of the bolts, then three again. Printed: time from an image to its
result, and error of the measured axis in arcsec and in its stated sigma.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from bolts import UP, Bolted
from plate_solved import draw

from msg_tools.units import ARCSEC, DEG
from pointing_model.runs.formats.csv import iso_utc
from pointing_model.sky.places import observed_to_icrs
from pointing_model.sky.site import Site

START = 1_795_000_000.0
LONGITUDE = 109.0
KEYWORDS = """\
images: 'img*.fits'
site: {{latitude_deg: {latitude}, longitude_deg: 109.0, height_m: 500}}
time_is: start
encoders_at: start
mount: equatorial
keywords: {{time: DATE-OBS, ha_enc_deg: HA, dec_enc_deg: DEC}}
"""


def image(folder, number, bolted, first, second, seconds):
    """Draw the field of the mount; the image file appears complete."""
    east, north, up = bolted.looks(first, second)[0]
    moment = START + seconds
    ra, dec = observed_to_icrs(np.arctan2(east, north), np.arcsin(up), moment,
                               Site(bolted.latitude, LONGITUDE * DEG, 500.0))
    part = folder / f'part{number}.fits'
    draw(part, float(ra), float(dec), {'DATE-OBS': iso_utc(np.array([moment]))[0].rstrip('Z'),
                                       'HA': first / DEG, 'DEC': second / DEG}, seed=number)
    os.utime(part)
    part.rename(folder / f'img{number:03d}.fits')


def altitude_and_azimuth(bolted):
    """Altitude and azimuth of the axis, for its end above the horizon, rad."""
    east, north, up = bolted.base.apply(bolted.mount.frame[2]) * np.sign(bolted.latitude)
    return np.arctan2(east, north), np.arcsin(up)


def one_mount(rng, latitude, wrong=False):
    """Images of one mount through the command: its results, and the truth for each image."""
    bolted = Bolted(latitude * DEG, 'equatorial', UP, dict(zip(
        ('ia', 'ie', 'ca', 'npae'), rng.normal(0.0, 600.0 * ARCSEC, 4))))
    turns = rng.uniform(1.0, 3.0, 2) * DEG * np.array([1.0 / np.cos(bolted.latitude), 1.0])
    turns *= rng.choice([-1.0, 1.0], 2)
    bolted.turn_azimuth(turns[0])
    bolted.raise_axis(turns[1])
    second = rng.uniform(10.0, 35.0) * DEG * np.sign(bolted.latitude)
    shots = [('arc', h * DEG) for h in (-50.0, -15.0, 25.0)]
    shots += [(share, 25.0 * DEG) for share in (-1.0, 0.0)] if wrong else [
        (share, 25.0 * DEG) for share in (0.3, 0.3, 0.3, 0.1)] + [
        ('arc', h * DEG) for h in (-40.0, -10.0, 30.0)]
    with tempfile.TemporaryDirectory(prefix='live_') as folder:
        folder = Path(folder)
        (folder / 'mount.yaml').write_text(KEYWORDS.format(latitude=latitude))
        out = folder / 'told.json'
        process = subprocess.Popen(
            [sys.executable, '-m', 'telescope_mount', 'bolts', '--live', folder, '--solver',
             'solve-field', '--scale', '55', '65', '--every', '0.5', '--for', '25', '--json', out,
             '--within', '60'], stdout=subprocess.PIPE, text=True)
        process.stdout.readline()  # it watches
        truth = []
        for number, (share, first) in enumerate(shots):
            if share != 'arc':
                bolted.turn_azimuth(-share * turns[0])
                bolted.raise_axis(-share * turns[1])
            image(folder, number, bolted, first, second, 30.0 * number)
            truth.append(altitude_and_azimuth(bolted))
            line = process.stdout.readline()
            while line and not line.startswith(f'img{number:03d}'):
                line = process.stdout.readline()
            if not line:
                break
            time.sleep(0.1)
        text = process.stdout.read()
        process.wait()
        return (json.loads(out.read_text())['images'], truth, process.returncode, text)


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--mounts', type=int, default=4)
    parser.add_argument('--seed', type=int, default=1)
    args = parser.parse_args()
    rng = np.random.default_rng(args.seed)
    seconds, off, ended, stopped = [], {'three': [], 'one': []}, 0, 0
    for number in range(args.mounts):
        latitude = (34.3, -30.0, 48.0, 65.0)[number % 4]
        told, truth, code, _ = one_mount(rng, latitude)
        ended += code == 0
        for one, (azimuth, altitude) in zip(told, truth):
            seconds.append(one['seconds'])
            axis = one['polar_axis']
            if axis:
                d = np.array([(axis['axis_azimuth_deg'] * DEG - azimuth + np.pi) % (2.0 * np.pi)
                              - np.pi, axis['axis_altitude_deg'] * DEG - altitude]) / ARCSEC
                sigma = np.array([axis['azimuth_sigma_arcsec'], axis['altitude_sigma_arcsec']])
                off[one['by']].append((np.hypot(d[0] * np.cos(altitude), d[1]), *(d / sigma)))
        told = one_mount(rng, latitude, wrong=True)[0]
        stopped += told[-1]['by'] == 'stopped'
        seconds += [one['seconds'] for one in told]
    print(f'{len(seconds)} images: number after {np.median(seconds):.1f} s (median), '
          f'{np.max(seconds):.1f} s at most')
    for by, rows in off.items():
        rows = np.array(rows)
        print(f'by {by} image(s): {np.median(rows[:, 0]):.1f}" off (median), '
              f'{rows[:, 0].max():.1f}" at most; {np.sqrt(np.mean(rows[:, 1:]**2)):.2f} sigma RMS')
    print(f'locked, measured once more and done: {ended} of {args.mounts}; '
          f'stopped where an error doubled: {stopped} of {args.mounts}')


if __name__ == '__main__':
    main()
