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

"""Files of elements: two-line sets, and OMM as keywords, XML, JSON or CSV (CCSDS 502.0-B-3)."""

import csv
import json
import re
from dataclasses import dataclass
from functools import cached_property
from xml.etree import ElementTree

import numpy as np

from ..elements import TYPES, Satellite, parse_sets
from .orbit_table import OrbitFormat

#: keywords of an OMM that are required, and defaults of the others
_NEEDED = ('EPOCH', 'MEAN_MOTION', 'ECCENTRICITY', 'INCLINATION', 'RA_OF_ASC_NODE',
           'ARG_OF_PERICENTER', 'MEAN_ANOMALY', 'NORAD_CAT_ID')
_DEFAULTS = {'CLASSIFICATION_TYPE': 'U', 'OBJECT_ID': '', 'EPHEMERIS_TYPE': '0',
             'ELEMENT_SET_NO': '0', 'REV_AT_EPOCH': '0', 'BSTAR': '0', 'MEAN_MOTION_DOT': '0',
             'MEAN_MOTION_DDOT': '0'}
#: theories whose elements SGP4 can use
_THEORIES = {'SGP', 'SGP4', 'SDP4'}
_KEY = re.compile(r'\s*([A-Z_0-9]+)\s*=\s*([^\[]*)')


@dataclass(frozen=True)
class MessageElements(Satellite):
    """Elements from an OMM.

    Attributes
    ----------
    fields : tuple of (str, str)
        Keywords and values.
    """

    line1: str = ''
    line2: str = ''
    fields: tuple = ()

    @cached_property
    def record(self):
        """The propagator, an `sgp4.api.Satrec`."""
        from sgp4 import omm
        from sgp4.api import Satrec
        record = Satrec()
        omm.initialize(record, dict(self.fields))
        return record


class ElementSets:
    """Several sets of elements of one satellite: each time uses the set of the nearest epoch.

    Parameters
    ----------
    sets : sequence of Satellite
    """

    precise = False
    begin, end = -np.inf, np.inf

    def __init__(self, sets):
        self.sets = sorted(sets, key=lambda one: one.epoch)
        self.name, self.number = self.sets[0].name, self.sets[0].number
        self._epochs = np.array([one.epoch for one in self.sets])

    @property
    def epoch(self):
        """Epoch of the newest set: UTC, seconds since 1970-01-01."""
        return float(self._epochs[-1])

    def itrf(self, time, rest=0.0, orientation=None):
        """See `elements.Satellite`."""
        return self._by_set(time, rest, Satellite.itrf, (3,))

    def sigma(self, time, rest=0.0):
        """See `elements.Satellite`."""
        return self._by_set(time, rest, Satellite.sigma, ())

    def _by_set(self, time, rest, of, width):
        time, rest = np.broadcast_arrays(np.asarray(time, float), rest)
        which = np.abs(time[..., None] - self._epochs).argmin(axis=-1)
        out = np.empty((*time.shape, *width))
        for i in np.unique(which):
            here = which == i
            out[here] = of(self.sets[i], time[here], rest[here])
        return out


def _two_lines(lines):
    return any(line.startswith('1 ') and len(line.rstrip()) > 60 for line in lines)


def _read_lines(path, lines):
    try:
        return parse_sets(lines)
    except ValueError as error:
        raise ValueError(f'{path}: {error}') from None


def _is_message(lines):
    text = '\n'.join(lines[:40])
    return 'MEAN_MOTION' in text and 'ECCENTRICITY' in text


def _read_messages(path, lines):
    """Elements in each message of a file.

    Raises
    ------
    ValueError
        One line: a missing keyword, a frame or theory that SGP4 does not use, or an invalid
        number.
    """
    text = '\n'.join(lines)
    try:
        tables = _tables(text.lstrip('\ufeff \n'), lines)
    except (ElementTree.ParseError, json.JSONDecodeError, csv.Error, AttributeError) as error:
        raise ValueError(f'{path} is damaged: {error}') from None
    return [_elements(path, table) for table in tables]


def _tables(text, lines):
    if text.startswith('<'):
        return [{element.tag: element.text or '' for element in block.iter()}
                for block in ElementTree.fromstring(text).iter('segment')]
    if text[:1] in '[{':
        found = json.loads(text)
        return found if isinstance(found, list) else [found]
    if '=' not in text:
        return list(csv.DictReader(lines))
    out = []
    for line in lines:
        found = _KEY.match(line)
        if found and (found[1] == 'OBJECT_NAME' or not out):
            out.append({} if not out or 'OBJECT_NAME' in out[-1] else out.pop())
        if found:
            out[-1][found[1]] = found[2].strip()
    return out


def _elements(path, table):
    known = {key: str(value).strip() for key, value in table.items() if value not in (None, '')}
    missing = [key for key in _NEEDED if key not in known]
    name = known.get('OBJECT_NAME', known.get('NORAD_CAT_ID', '?'))
    if missing:
        raise ValueError(f'{path}: the elements of {name} lack {", ".join(missing)}')
    if known.get('TIME_SYSTEM', 'UTC') != 'UTC' or known.get('REF_FRAME', 'TEME') != 'TEME':
        raise ValueError(f'{path}: the elements of {name} are in {known.get("REF_FRAME")}, '
                         f'{known.get("TIME_SYSTEM")}; SGP4 takes TEME, UTC')
    center = known.get('CENTER_NAME', 'EARTH')
    theory = known.get('MEAN_ELEMENT_THEORY', 'SGP4')
    kind = known.get('EPHEMERIS_TYPE', '0')
    other = (f'about {center}' if center.upper() != 'EARTH' else
             f'of the theory {theory}' if not set(theory.upper().split('/')) <= _THEORIES else
             f'of type {kind} (EPHEMERIS_TYPE)' if kind not in TYPES else '')
    if other:
        raise ValueError(f'{path}: the elements of {name} are {other}; give elements of SGP4 about '
                         'the Earth, or a precise orbit')
    epoch = known['EPOCH'].rstrip('Z')
    known['EPOCH'] = epoch if '.' in epoch else f'{epoch}.0'
    satellite = MessageElements(fields=tuple((_DEFAULTS | known).items()))
    try:
        bad = satellite.record.error or not satellite.record.no_kozai > 0.0
    except (ValueError, KeyError, OverflowError) as error:
        raise ValueError(f'{path}: the elements of {name}: {error}') from None
    if bad:
        raise ValueError(f'{path}: the elements of {name} describe no orbit')
    return satellite


ORBIT_FORMATS = (OrbitFormat('OMM', _is_message, _read_messages),
                 OrbitFormat('two-line elements', _two_lines, _read_lines))
