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

"""Generates the tutorials' runs, from simulated nights, and the pictures of their pages.

    .venv/bin/python docs/make/tutorials.py            # the runs, in examples/tutorial
    .venv/bin/python docs/make/tutorials.py pictures   # screenshots of their pages with chromium

The scenarios are in the same folder as the runs. A night has two power-ons: two nights for the
alt-azimuth mount; for the German one only the first, as plate solves with the place reported by
the mount.
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
RUNS = ROOT / 'examples' / 'tutorial'
PICTURES = ROOT / 'docs' / 'pictures'
sys.path.insert(0, str(ROOT))

from msg_tools.units import DEG, wrap  # noqa: E402
from pointing_model.mounts import is_beyond, through_pole  # noqa: E402
from pointing_model.runs.formats.csv import iso_utc  # noqa: E402
from pointing_model.runs.plate_solves.frames import OF_DATE, to_icrs  # noqa: E402
from pointing_model.sky.places import observed_to_icrs, sidereal_time  # noqa: E402
from pointing_model.sky.refraction import Weather  # noqa: E402
from pointing_model.sky.site import DEFAULT_SITE  # noqa: E402
from telescope_mount.input_files.run_loader import load_run  # noqa: E402

#: name of a picture, command for its page, width and height shown, pixels
PAGES = {
    'tutorial_altaz_fit': ('fit examples/tutorial/altaz_night1.csv', 900, 690),
    'tutorial_altaz_diagnosis': ('diagnose examples/tutorial/altaz_night1.csv '
                                 '--holdout examples/tutorial/altaz_night2.csv', 1250, 1520),
    'tutorial_german_fit': ('fit examples/tutorial/german_solved.csv', 900, 690),
    'tutorial_german_diagnosis': ('diagnose examples/tutorial/german_solved.csv', 1250, 1130),
}


def run(*words):
    """Run a command of this project."""
    subprocess.run([sys.executable, '-m', 'telescope_mount', *words], cwd=ROOT, check=True,
                   stdout=subprocess.DEVNULL)


def night(folder, name, stars):
    """Rows of the stars of a simulated night, without those for the zero, by power-on."""
    run('night', '--scenario', f'examples/tutorial/{name}.yaml', '--stars', str(stars),
        '--polaris', '4', '--seed', '3', '--out', str(folder / name))
    rows = load_run(folder / name / 'bag')
    star = rows['for_zero'] != 1
    return [rows.select(star & (rows['run'] == number)) for number in (1, 2)]


def write(name, comments, columns):
    """Write a table with its comments."""
    path = RUNS / name
    with open(path, 'w', encoding='utf-8') as stream:
        stream.writelines(f'# {line}\n' for line in comments)
        stream.write(','.join(columns) + '\n')
        stream.writelines(','.join(row) + '\n' for row in zip(*columns.values()))
    print(path.relative_to(ROOT), len(next(iter(columns.values()))), 'rows')


def degrees(values, digits=5):
    """Angles as written to a file."""
    return [f'{value / DEG:.{digits}f}' for value in values]


def altaz(folder):
    """Write two nights as CSV."""
    for number, rows in enumerate(night(folder, 'altaz', 60), 1):
        write(f'altaz_night{number}.csv', [], {
            'time': [text[:19] + 'Z' for text in iso_utc(rows['time'])],
            'star': [f'HIP {star:.0f}' for star in rows['star']],
            **{f'{name}_deg': degrees(rows[name]) for name in ('az', 'el', 'az_enc', 'el_enc')},
            'temperature_c': [f'{value:.1f}' for value in rows['temperature']]})


def german(folder):
    """Write plate solves, with the places reported by the mount, as J2000."""
    rows, _ = night(folder, 'german', 80)
    mount, site, time = rows.mount, DEFAULT_SITE, rows['time']
    ra, dec = observed_to_icrs(*mount.horizon_of(rows['az'], rows['el']), time, site,
                               Weather(955.0, 10.0))
    first, second = rows['az_enc'], rows['el_enc']
    west = is_beyond(second)
    first, second = through_pole(first, second, west)
    mount_ra, mount_dec = to_icrs(sidereal_time(time, site) - wrap(first), second, OF_DATE, time)
    write('german_solved.csv', [
        'frame: ICRS', 'readings: J2000', 'mount: german', f'latitude_deg: {site.latitude / DEG:g}',
        f'longitude_deg: {site.longitude / DEG:g}', f'height_m: {site.height:g}',
        'pressure_hpa: 955', 'temperature_c: 10'], {
        'star': [f'LIGHT_{i:04d}.fits' for i in range(1, len(rows) + 1)],
        'time': [text[:23] + 'Z' for text in iso_utc(time)],
        'ra_deg': degrees(ra, 6), 'dec_deg': degrees(dec, 6),
        'ra_enc_deg': degrees(mount_ra, 6), 'dec_enc_deg': degrees(mount_dec, 6),
        'pier_side': np.where(west, 'West', 'East').tolist()})


def picture(name, command, width, height, folder):
    """The top of a page as shown by chromium, with few colours."""
    from PIL import Image
    page, shot = folder / 'page.html', folder / 'shot.png'
    run(*command.split(), '--report', str(page), '--overwrite')
    subprocess.run([
        shutil.which('chromium') or 'chrome', '--headless=new', '--no-sandbox', '--disable-gpu',
        '--hide-scrollbars', f'--window-size={width},{height}', f'--screenshot={shot}',
        f'file://{page}'], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    path = PICTURES / f'{name}.png'
    Image.open(shot).convert('RGB').quantize(48).save(path, optimize=True)
    print(path.relative_to(ROOT), path.stat().st_size)


def main():
    """Write runs or pictures."""
    with tempfile.TemporaryDirectory() as folder:
        if 'pictures' in sys.argv[1:]:
            for name, (command, width, height) in PAGES.items():
                picture(name, command, width, height, Path(folder))
        else:
            altaz(Path(folder))
            german(Path(folder))


if __name__ == '__main__':
    main()
