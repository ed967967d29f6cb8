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

"""Writes the page of causes known to the diagnosis, from the effects themselves.

    .venv/bin/python docs/make/effects.py
"""

import re
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from msg_tools.units import DEG  # noqa: E402
from pointing_model.context import Context  # noqa: E402
from pointing_model.effects import dictionary  # noqa: E402
from pointing_model.effects.base import driver_word  # noqa: E402
from pointing_model.mounts import parse_mount  # noqa: E402
from pointing_model.runs.run import PointingRun  # noqa: E402
from pointing_model.sky.site import Site  # noqa: E402

#: names of drivers for readers
WORDS = {'lst': 'sidereal time', 'reading_az': 'reading of the encoder', 'az_rate': 'rate',
         'miss_x': 'miss distance', 'run': 'power-on', 'approach_az': 'direction of approach',
         'approach_el': 'direction of approach'}
SIDES = 'it differs by the side of the pier'
PAGE = ROOT / 'docs' / 'effects.md'
HEAD = """<!-- made by docs/make/effects.py from pointing_model/effects; do not edit -->
# Causes that the diagnosis knows

Each is tried where the run can show it. One row stands for all orders and for both axes.
*Follows*: what the error depends on. [From residual to cause](residual_to_cause.md) leads here.
"""


def run_of(kind):
    """A run in which all effects are possible: all columns, with random values."""
    rng, n = np.random.default_rng(1), 240
    site = Site()
    mount = parse_mount(kind, site.latitude)
    az, el = rng.uniform(0.0, 2 * np.pi, n), rng.uniform(20.0, 80.0, n) * DEG
    side = np.arange(n) % 2 == 1 if kind == 'german' else False
    first, second = (az, el) if mount.vertical else mount.axes_of(az, el, side)
    columns = {'az': first, 'el': second, 'az_enc': first, 'el_enc': second, 'az_raw': first,
               'el_raw': second, 'time': 1.7e9 + 120.0 * np.arange(n),
               'run': np.repeat((1, 2, 3, 4), n // 4), 'approach_az': rng.choice((-1, 1), n),
               'approach_el': rng.choice((-1, 1), n), 'ra_pm': rng.normal(size=n)}
    for name in ('temperature', 'pressure', 'magnitude', 'wind_speed', 'wind_from', 'humidity',
                 'miss_x', 'miss_y', 'az_rate', 'el_rate'):
        columns[name] = rng.normal(size=n) * (1e-4 if '_' in name else 1.0)
    columns['rotator_deg'] = rng.uniform(0.0, 360.0, n)
    if mount.vertical:  # cables and a cage count whole turns
        columns['az_enc'] = first + 2.0 * np.pi * rng.integers(-1, 2, n)
    return PointingRun(columns, {'site': site, 'mount': mount, 'raw_reading': True,
                                 'graduation': {}, 'worms': {'az': 180.0}})


#: words of an equatorial mount, and those of the tables before
AXES = (('hour angle', 'azimuth'), ('polar axis', 'azimuth axis'), ('declination', 'elevation'),
        ('CH', 'CA'), ('fork or saddle', 'saddle'), ('δ', 'E'),
        ('disc, worm wheel or horseshoe ring', 'disc'), ('disc or worm wheel', 'disc'))


def alike(text):
    """Normalized text: without numbers, with one word for both axes, lower case."""
    for own, word in AXES:
        text = re.sub(rf'\b{own}\b', word, text, flags=re.I)
    return re.sub(r'\b(azimuth|elevation)\b', 'axis', re.sub(r'[\d.]+', '#', text.lower()))


def rows_of(kind):
    """Cause, driver, and what to check; one row for effects that differ only by order or axis."""
    found = {}
    for effect in dictionary(Context.from_run(run_of(kind)))[0]:
        key = effect.form, effect.look_at, re.sub(r'_?(az|el|azimuth|elevation|hour_angle|'
                                                  r'declination)\b', '', effect.driver)
        found.setdefault(key, []).append(effect)
    for effects in found.values():
        first = effects[0]
        if SIDES in first.cause:
            continue
        cause, driver = first.cause, WORDS.get(first.driver, driver_word(first.driver))
        if 'column' in cause:
            cause, driver = 'follows a column of the file', 'that column'
        yield cause[:1].upper() + cause[1:], driver, first.look_at


def page():
    """Text of the page."""
    out, listed = [HEAD], set()
    for title, kind in (('Any mount, in the words of an alt-azimuth one', 'altaz'),
                        ('Equatorial mounts also', 'equatorial'), ('German mounts also', 'german')):
        lines = [f'\n## {title}\n', '| cause | follows | look at |', '| --- | --- | --- |']
        for cause, driver, look_at in rows_of(kind):
            # orders and axes of one cause are one row
            if alike(cause) in listed or kind != 'altaz' and alike(look_at) in listed:
                continue
            listed |= {alike(cause), alike(look_at)}
            lines.append(f'| {cause} | {driver} | {look_at} |')
        out += lines
    out.append('\nEach effect and term may also differ by the side of the pier: mirror cell, '
               'focuser, counterweight.')
    return '\n'.join(out) + '\n'


if __name__ == '__main__':
    PAGE.write_text(page(), encoding='utf-8')
    print(PAGE)
