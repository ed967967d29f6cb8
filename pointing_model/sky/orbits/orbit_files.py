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

"""Orbits from one or several files, whatever their kinds: known by content, joined by satellite."""

from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

import numpy as np

from ..elements import Satellite
from .elements_files import ElementSets
from .ephemeris import Orbit
from .time_scales import utc_text
from .unix_compress import read_text

_MODULES = [import_module(f'.{name}', __package__) for name in sorted(
    module.name for module in iter_modules([str(Path(__file__).parent)]))
    if name != Path(__file__).stem]
#: what modules of this package declare
FORMATS = [one for module in _MODULES for one in getattr(module, 'ORBIT_FORMATS', ())]
#: m, from which on a jump where files overlap is reported
_JUMP = 1.0


class Orbits:
    """The satellites of some files.

    Attributes
    ----------
    notes : list of str
        What was left out or does not fit, for people.
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
        """Of the satellites, sorted."""
        return sorted({one.name for found in self._found.values() for _, one in found})

    def orbit(self, name=None):
        """The orbit of a satellite by all files that have it.

        Parameters
        ----------
        name : str, optional
            Its name or number; needed where there are several.

        Returns
        -------
        Orbit, Satellite or ElementSets

        Raises
        ------
        ValueError
            There is no such satellite, or none is named of several.
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
        names = (plain, number, f'G{number:0>2}')  # those of GPS are often given as numbers
        return next((self._found[one] for one in names if one in self._found), [])

    def _joined(self, name, found):
        elements = [one for _, one in found if isinstance(one, Satellite)]
        precise = [(path, one) for path, one in found if not isinstance(one, Satellite)]
        if not precise:
            return elements[0] if len(elements) == 1 else ElementSets(elements)
        if elements:
            self.notes.append(f'{name}: positions of files are taken in place of elements')
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
    raise ValueError(f'{path} is no orbit; known are {", ".join(one.wording for one in FORMATS)}')


def _plain(name):
    text = str(name).strip().upper()
    return text.lstrip('0') if text.isdigit() else text


def _listed(names):
    return ', '.join(names[:40]) + (f' and {len(names) - 40} more' if len(names) > 40 else '')
