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

"""Orbits from one or several files: formats recognized by content, joined by satellite.

Files may be plain, or compressed by gzip or ``compress`` (.Z), as in archives.
"""

import gzip
import zlib
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

import numpy as np

from ..elements import Satellite
from .elements_files import ElementSets
from .ephemeris import Orbit
from .time_scales import utc_text

_GZIP, _COMPRESS = b'\x1f\x8b', b'\x1f\x9d'
_BLOCK, _CLEAR, _MAGIC = 0x80, 256, 3
#: largest plausible uncompressed size, bytes
_MOST = 400_000_000
_MODULES = [import_module(f'.{name}', __package__) for name in sorted(
    module.name for module in iter_modules([str(Path(__file__).parent)]))
    if name != Path(__file__).stem]
#: formats declared by the modules of this package
FORMATS = [one for module in _MODULES for one in getattr(module, 'ORBIT_FORMATS', ())]
#: least discontinuity between overlapping files that is reported, m
_JUMP = 1.0


class Orbits:
    """The satellites in some files.

    Attributes
    ----------
    notes : list of str
        Data that were left out or are inconsistent, for people.
    """

    def __init__(self, paths):
        self.notes, self._files = [], ', '.join(Path(path).name for path in paths)
        self._found, self._read = {}, {}
        for path in map(Path, paths):
            for one in _read_file(path):
                name = one.name
                for other in (name, *getattr(one, 'other_names', ())):
                    self._found.setdefault(_plain(other), []).append((path, one))

    @property
    def names(self):
        """Names of the satellites, sorted."""
        return sorted({one.name for found in self._found.values() for _, one in found})

    def orbit(self, name=None):
        """Orbit of a satellite from all files that contain it.

        Parameters
        ----------
        name : str, optional
            Its name or number; required if there are several satellites.

        Returns
        -------
        Orbit, Satellite or ElementSets

        Raises
        ------
        ValueError
            There is no such satellite, or no name is given although there are several.
        """
        there = self.names
        if name is None:
            if len(there) > 1:
                raise ValueError(f'{self._files}: {len(there)} satellites; name one with --object: '
                                 f'{_listed(there)}')
            name = there[0]
        found = self._find(str(name))
        if not found:
            raise ValueError(f'{self._files}: no satellite {name}; there are {_listed(there)}')
        key = found[0][1].name
        if key not in self._read:
            self._read[key] = self._joined(key, found)
        return self._read[key]

    def _find(self, name):
        plain = _plain(name)
        number = plain.removeprefix('PRN')
        names = (plain, number, f'G{number:0>2}')  # GPS satellites are often given by number
        return next((self._found[one] for one in names if one in self._found), [])

    def _joined(self, name, found):
        elements = [one for _, one in found if isinstance(one, Satellite)]
        precise = [(path, one) for path, one in found if not isinstance(one, Satellite)]
        if not precise:
            return elements[0] if len(elements) == 1 else ElementSets(elements)
        if elements:
            self.notes.append(f'{name}: positions of files are used, not elements')
        arcs = sorted((arc for path, one in precise for arc in one.arcs(path, self.notes)),
                      key=lambda arc: arc.begin)
        out = []
        for arc in arcs:
            if out and out[-1].goes_on(arc):
                out[-1] = out[-1].followed(arc)
                continue
            if out and out[-1].end > arc.begin:
                self._note_jump(name, out[-1], arc)
            out.append(arc)
        return Orbit(name, tuple(out))

    def _note_jump(self, name, before, arc):
        both = (arc.origin + arc.epochs >= before.begin) & (arc.origin + arc.epochs <= before.end)
        at = arc.epochs[both]
        if not len(at):
            return
        off = np.linalg.norm(arc.places[both] - before.itrf(at + (arc.origin - before.origin)),
                             axis=1)
        if off.max() > _JUMP:
            self.notes.append(
                f'{name}: where {before.source} and {arc.source} overlap, from '
                f'{utc_text(arc.origin + at[0])} UTC on, they differ by '
                f'{np.sqrt(np.mean(off**2)):.1f} m RMS; the later one is taken')


def _read_file(path):
    lines = read_text(path)
    while lines and not lines[0].strip():
        lines = lines[1:]
    for one in FORMATS:
        if one.looks_like(lines):
            return one.read(path, lines)
    raise ValueError(f'{path} is no orbit file; known: {", ".join(one.wording for one in FORMATS)}')


def _plain(name):
    text = str(name).strip().upper()
    return text.lstrip('0') if text.isdigit() else text


def _listed(names):
    return ', '.join(names[:40]) + (f' and {len(names) - 40} more' if len(names) > 40 else '')


def read_text(path):
    """Lines of a file, decompressed if its first bytes require it.

    Raises
    ------
    ValueError
        It is truncated or damaged.
    OSError
        It cannot be read.
    """
    data = Path(path).read_bytes()
    try:
        if data.startswith(_GZIP):
            data = gzip.decompress(data)
        elif data.startswith(_COMPRESS):
            data = _uncompressed(data)
    except (EOFError, zlib.error, gzip.BadGzipFile, IndexError) as error:
        raise ValueError(f'{path}: the compressed file is cut or damaged ({error}); '
                         'fetch it again') from None
    return data.decode('ascii', 'replace').splitlines()


def _uncompressed(data):
    """Decompress LZW of ``compress``: codes of 9 or more bits, in groups of eight."""
    flags = data[2]
    most, block = flags & 0x1f, bool(flags & _BLOCK)
    table = [bytes([i]) for i in range(256)] + ([b''] if block else [])
    width, out, size, before, at, bits = 9, [], 0, None, 8 * _MAGIC, 8 * len(data)
    start = at
    while at + width <= bits:
        first = at >> 3
        code = int.from_bytes(data[first:first + 4], 'little') >> (at & 7) & (1 << width) - 1
        at += width
        if block and code == _CLEAR:
            # codes of one width are padded to whole groups of eight
            at, table, before = _group_end(start, at, width), table[:257], None
            width, start = 9, at
            continue
        if before is None:
            word = table[code]
        else:
            word = table[code] if code < len(table) else before + before[:1]
            if len(table) < 1 << most:
                table.append(before + word[:1])
                if len(table) == 1 << width and width < most:
                    at = _group_end(start, at, width)
                    width, start = width + 1, at
        out.append(word)
        size += len(word)
        if size > _MOST:
            raise EOFError('more than 400 MB')
        before = word
    return b''.join(out)


def _group_end(start, at, width):
    group = 8 * width
    return start + -(-(at - start) // group) * group
