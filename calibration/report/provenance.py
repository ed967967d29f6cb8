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

"""Subject and origin of a page: site, date, command, versions, files."""

import shlex
import sys
from datetime import datetime, timezone
from hashlib import sha256
from pathlib import Path, PurePath

import numpy as np

from msg_tools import version_of
from msg_tools.units import DEG
from pointing_model.runs.run import known_site

from . import page_parts as page

#: largest file with a checksum, bytes
_LARGEST = 500_000_000


def command_line():
    """The running command as typed in a shell."""
    return shlex.join([PurePath(sys.argv[0]).name.replace('cli.py', 'telescope-mount'),
                       *sys.argv[1:]])


def provenance_section(rows, files=()):
    """Section on the origin of the page.

    Parameters
    ----------
    rows : sequence of (str, str)
        Label and value; empty ones are omitted. The command and the version come first.
    files : iterable of Path
        Files, or folders with all their files; missing ones are omitted.

    Returns
    -------
    Markup
    """
    now = datetime.now(timezone.utc)
    facts = [('command', command_line()), ('version', f'telescope_mount {version_of()}'.strip()),
            ('written', f'{now:%Y-%m-%d %H:%M} UTC'), *rows]
    return page.folded_section('Provenance', [
        page.definitions([row for row in facts if row[1] not in ('', None)]), _files(files)])


def _files(files):
    rows = []
    for path in map(Path, files):
        inside = sorted(p for p in path.iterdir() if p.is_file()) if path.is_dir() else [path]
        for one in inside:
            if one.is_file():
                name = f'{path.name}/{one.name}' if path.is_dir() else one.name
                size = one.stat().st_size
                total = sum_of(one) if size <= _LARGEST else 'too large to sum up'
                rows.append((name, f'{size}', page.code(total)))
    return page.table(('file', 'bytes', 'SHA-256'), rows, '', 'Files and their sums')


def sum_of(path):
    """SHA-256 of a file, as hexadecimal digits."""
    total = sha256()
    with open(path, 'rb') as file:
        while block := file.read(1 << 20):
            total.update(block)
    return total.hexdigest()


def site_text(site):
    """Site of a mount in words.

    Parameters
    ----------
    site : dict or None
        ``latitude_deg``, ``longitude_deg``, ``height_m``, any of them.
    """
    site = {name: value for name, value in (site or {}).items()
            if isinstance(value, (int, float))}
    out = [f'{word} {site[name]:g}{unit}' for name, word, unit in (
        ('latitude_deg', 'latitude', '°'), ('longitude_deg', 'longitude', '°'),
        ('height_m', 'height', ' m')) if name in site]
    return ', '.join(out)


def about(obs, sources):
    """Name, date and site, as far as known.

    Parameters
    ----------
    obs : Observations
    sources : sequence of str
        Names of the files; the first is used as name if the file has no caption.

    Returns
    -------
    str
        '' if nothing is known.
    """
    caption = str(obs.run.meta.get('caption') or '').strip()
    name = caption or (PurePath(sources[0]).stem if sources else '')
    return ', '.join(filter(None, [name, _date(obs), _site(obs.run.meta)]))


def axes_note(context):
    """Meaning of the axis angles for rows through the pole; '' if there are none.

    Parameters
    ----------
    context : Context
    """
    names, through = context.mount.names, np.abs(context.el) > np.pi / 2.0
    if not through.any():
        return ''
    first, second = names.axes
    way = 'past the zenith' if context.mount.vertical else 'through the pole'
    text = (f'{first.capitalize()} and {second} are those of the axes. '
            f'In {int(through.sum())} of {len(context)} rows the telescope looks {way}, '
            f'the {second} beyond 90°')
    if names.columns[0] == 'ha':
        text += f'. There the {first} of the axis is 12 h from that of the star'
    return f'{text}.'


def _date(obs):
    """First and last day, UTC."""
    times = obs.context.get('time')
    known = np.zeros(0) if times is None or not getattr(obs.context, 'time_is_utc', True) \
        else times[np.isfinite(times)]
    if not known.size:
        return str(obs.run.meta.get('date') or '')
    first, last = (f'{datetime.fromtimestamp(float(t), timezone.utc):%Y-%m-%d}'
                   for t in (known.min(), known.max()))
    return first if first == last else f'{first} to {last}'


def _site(meta):
    """Latitude and longitude."""
    known = site_degrees(meta)
    return ' '.join(f'{abs(known[key]):.2f}° {ways[known[key] < 0.0]}' for key, ways in (
        ('latitude_deg', 'NS'), ('longitude_deg', 'EW')) if key in known)


def site_degrees(meta):
    """The argument of `site_text`, from the ``meta`` of a run."""
    given = known_site(meta)
    return {f'{name}_{unit}': given[name] / size for name, unit, size in (
        ('latitude', 'deg', DEG), ('longitude', 'deg', DEG), ('height', 'm', 1.0))
            if given.get(name) is not None}
