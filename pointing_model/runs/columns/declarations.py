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

"""Declarations in the comments above a CSV file's header row: frame, site, air."""

import difflib
import re

from pointing_model.runs.plate_solves.frames import Frame, parse_frame
from pointing_model.sky.refraction import AIR
from pointing_model.sky.site import SITE

#: key in a file -> part of ``meta``, and its field, unit and limits
NUMBERS = {key: (part, one) for part, table in (('site', SITE), ('weather', AIR))
           for key, one in table.items()}
_KEYS = ('frame', 'readings', 'mount', 'unsolved', *NUMBERS)
_LINE = re.compile(r'#\s*([A-Za-z_]+)\s*[:=]\s*(\S.*?)\s*')
_NUMBER = re.compile(rf'#\s*({"|".join(NUMBERS)})\s+([-+.\d]\S*)')


def declarations(path, lines, header=False):
    """Comments ``# key: value`` before the first row; for numbers also ``# key value``.

    Parameters
    ----------
    path : Path
        For messages.
    lines : list of str
        Of the file.
    header : bool
        Whether the first row names the columns. Comments between it and the first row of values
        then count too.

    Returns
    -------
    dict
        For ``meta``: ``mount_declared``, ``sky_frame`` and ``readings_frame`` (`Frame`), ``site``
        and ``weather`` (dict, SI), if declared; ``notes`` on images that were not solved and on
        keys that look mistyped. Other comments are ignored.

    Raises
    ------
    ValueError
        A value is not a number or out of range, a frame is unknown, or a key occurs twice.
    """
    out, seen, notes = {}, set(), []
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        if not line.lstrip().startswith('#'):
            if not header:
                break
            header = False
            continue
        found = _LINE.fullmatch(line.strip()) or _NUMBER.fullmatch(line.strip())
        if not found:
            continue
        key, value = found[1].lower(), found[2]
        key = 'frame' if key == 'equinox' else key
        if key not in _KEYS:
            near = difflib.get_close_matches(key, _KEYS, 1, 0.8)
            if near:
                notes.append(f'row {number}: comment {key!r} not read; did you mean {near[0]}?')
            continue
        where = f'{path}, row {number}'
        if key in seen:
            raise ValueError(f'{where}: {key} is declared twice')
        seen.add(key)
        if key == 'unsolved':
            notes.append(f'{value[:80]} were not solved: those that were may be no fair sample '
                         '(low, faint and trailed ones are missing)')
            continue
        declare(out, key, value, where)
    return {**out, 'notes': notes}


def declare(out, key, value, where):
    """Store one declared value under the name that ``meta`` uses.

    Parameters
    ----------
    out : dict
        Changed in place: gets ``mount_declared``, a frame, or a field of ``site`` or ``weather``.
    key : str
        ``mount``, ``frame``, ``readings`` (the frame of ``ra_enc_deg``), or one of `NUMBERS`.
    value : str or float
    where : str
        For messages.

    Raises
    ------
    ValueError
        See `declarations`.
    """
    if key == 'mount':
        out['mount_declared'] = str(value)
        return
    if key in ('frame', 'readings'):
        try:
            frame = value if isinstance(value, Frame) else parse_frame(value)
            out['sky_frame' if key == 'frame' else 'readings_frame'] = frame
        except ValueError as error:
            raise ValueError(f'{where}: {error}') from None
        return
    part, one = NUMBERS[key]
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise ValueError(f'{where}: {key} {str(value)[:40]!r} is not a number') from None
    if not one.low <= number <= one.high:
        raise ValueError(f'{where}: {key} {number:g} is outside {one.low:g} to {one.high:g}')
    out.setdefault(part, {})[one.field] = number * one.size
