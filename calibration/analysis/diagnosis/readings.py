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

"""Readings of the columns of a pointing run: wrong units, signs, zeros, swapped columns."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from msg_tools.units import DEG, wrap
from pointing_model.mounts import ALTAZ, is_beyond, through_pole

_CATALOGUE, _ENCODERS, _BOTH = 'of the catalogue', 'of the encoders', 'of catalogue and encoders'
_SYNCED = 'offsets added up from star to star'
#: mistakes in one pair of columns, in the order of correction: text (with the names of the axes),
#: function from (az, el) as written to the true (az, el), and scale factors of both angles
_MISTAKES = {
    'arcseconds': ('{a} and {e} {of} in arcseconds',
                   lambda a, e: (a / 3600.0, e / 3600.0), (1.0 / 3600.0, 1.0 / 3600.0)),
    'arcminutes': ('{a} and {e} {of} in arcminutes',
                   lambda a, e: (a / 60.0, e / 60.0), (1.0 / 60.0, 1.0 / 60.0)),
    'gradians': ('{a} and {e} {of} in gradians, 400 to the turn',
                 lambda a, e: (0.9 * a, 0.9 * e), (0.9, 0.9)),
    'radians': ('{a} and {e} {of} in radians', lambda a, e: (a / DEG, e / DEG),
                (1.0 / DEG, 1.0 / DEG)),
    'swapped': ('{a} and {e} {of} exchanged', lambda a, e: (e, a), (1.0, 1.0)),
    'hours': ('{a} {of} in hours', lambda a, e: (15.0 * a, e), (15.0, 1.0)),
    'radians of the first': ('{a} {of} in radians', lambda a, e: (a / DEG, e), (1.0 / DEG, 1.0)),
    'reversed': ('{a} {of} counted the other way', lambda a, e: (-a, e), (1.0, 1.0)),
    'negative': ('{e} {of} with the other sign', lambda a, e: (a, -e), (1.0, 1.0)),
    'zenith': ('{d} in place of the {e} {of}',
               lambda a, e: (a, 0.5 * np.pi - e), (1.0, 1.0)),
    'synced': (_SYNCED, None, (1.0, 1.0)),
    # mounts that go through the pole
    'unturned': ('{e} {of} beyond 90 degrees with the {a} of the star, not 180 degrees on',
                 lambda a, e: (np.where(is_beyond(e), a + np.pi, a), e), (1.0, 1.0)),
    'folded': ('{e} {of} folded back to below 90 degrees where the {a} is 180 degrees on, through '
               'the pole', None, (1.0, 1.0)),
    'sideless': ('a German mount, its {e} {of} folded back to below 90 degrees where stars east of '
                 'the meridian are through the pole', None, (1.0, 1.0)),
    # equatorial mounts
    'ascension': ('right ascension in place of the {a} {of}', None, (1.0, 1.0)),
}
#: mutually exclusive mistakes
_UNITS = ('arcseconds', 'arcminutes', 'gradians', 'radians', 'hours', 'radians of the first')
_OF_PAIRS = (*_UNITS, 'swapped', 'reversed', 'negative', 'zenith')
#: offsets in the encoder columns: text -> factor to degrees with sign, whether x is on the sky
_OFFSETS = {
    f'{name}{where}, {sign}': (factor * direction, bool(where))
    for name, factor in (('degrees', 1.0), ('arcseconds', 1.0 / 3600.0))
    for where in ('', ' on the sky')
    for sign, direction in (('encoder - catalogue', 1.0), ('catalogue - encoder', -1.0))}
#: mistakes in the on-sky offsets of a file: text, function from (x, y, cosine of the second angle)
#: as written to the true (x, y), and the power of the cosine by which they are multiplied
_GIVEN = {
    'no cosine': ('column x_arcsec not multiplied by cos({e})', lambda x, y, c: (x * c, y), 1),
    'cosine twice': ('column x_arcsec multiplied twice by cos({e})',
                     lambda x, y, c: (x / c, y), -1),
    'negative': ('column x_arcsec or y_arcsec with the other sign', lambda x, y, _: (-x, y), 0),
    'exchanged': ('columns x_arcsec and y_arcsec exchanged', lambda x, y, _: (y, x), 0),
    'turned': ('columns x_arcsec and y_arcsec exchanged, one of them with the other sign',
               lambda x, y, _: (y, -x), 0),
    'synced': (_SYNCED, lambda x, y, c: (c * np.cumsum(x / c), np.cumsum(y)), 0)}


@dataclass(frozen=True)
class Places:
    """Catalogue positions and encoder angles in one reading.

    Attributes
    ----------
    az, el, az_enc, el_enc : ndarray, shape (n,)
        Radians.
    gain : ndarray, shape (n,)
        Product of the on-sky offsets in x and y for a unit change of both encoder columns as
        written: misfits of two readings compare when each is divided by it.
    """

    az: np.ndarray
    el: np.ndarray
    az_enc: np.ndarray
    el_enc: np.ndarray
    gain: np.ndarray


@dataclass(frozen=True)
class Reading:
    """One way to read the four columns.

    Attributes
    ----------
    catalogue, encoders : tuple of str
        Mistakes of each pair (keys of `_MISTAKES`), in the order of correction.
    offsets : str
        Kind of offsets in the encoder columns (key of `_OFFSETS`); '': they hold angles.
    exchanged : bool
        Whether catalogue and encoder columns are exchanged.
    given : str
        Mistake in the offsets of a file with offsets in place of angles (key of `_GIVEN`); '':
        none.
    """

    catalogue: tuple = ()
    encoders: tuple = ()
    offsets: str = ''
    exchanged: bool = False
    given: str = ''
    #: not a change of clock or site
    elsewhere = False

    @property
    def kind(self):
        """What is wrong."""
        return 'syncs' if 'synced' in (self.given, *self.encoders) else 'columns'

    @property
    def advice(self):
        """What to do."""
        if 'sideless' in self.encoders:
            return 'give --mount german and a column pier_side, or for a fork --mount equatorial'
        return ('observe without synchronising, or add up the offsets' if self.kind == 'syncs'
                else 'set the columns right')

    @property
    def mistakes(self):
        """Number of mistakes."""
        return (len(set(self.catalogue) | set(self.encoders)) + bool(self.offsets)
                + self.exchanged + bool(self.given))

    def places(self, az, el, az_enc, el_enc, held=False, lst=None, sidereal=False):
        """Correct the columns.

        Parameters
        ----------
        az, el, az_enc, el_enc : ndarray, shape (n,)
            As written, converted from degrees to radians.
        held : bool
            Whether the file has on-sky offsets in place of encoder angles. The offsets are kept:
            only the catalogue, or the offsets themselves, can be mistaken.
        lst : ndarray, shape (n,), optional
            Sidereal time, radians, with an unknown zero unless `sidereal`.
        sidereal : bool
            Whether the zero of `lst` is known.

        Returns
        -------
        Places
        """
        if 'ascension' in (*self.catalogue, *self.encoders):
            az, az_enc = self._from_ascension(az, az_enc, el_enc, lst, sidereal)
        if held:
            turned = is_beyond(el) != is_beyond(el_enc)
            first, second = through_pole(az, el, turned)
            cosine = np.abs(np.cos(el))
            _, work, power = _GIVEN.get(self.given, ('', lambda x, y, _: (x, y), 0))
            x, y = work(wrap(az_enc - first) * np.cos(second), wrap(el_enc - second), cosine)
            scale = cosine**power
        if self.exchanged:
            az, el, az_enc, el_enc = az_enc, el_enc, az, el
        az, el, _ = _set_right(az, el, self.catalogue)
        reach = np.cos(el)
        if held:
            first, second = through_pole(az, el, turned)
            az_enc, el_enc, reach = first + x / np.cos(second), second + y, 1.0
        elif self.offsets:
            unit, on_sky = _OFFSETS[self.offsets]
            scale, reach = unit**2, 1.0 if on_sky else reach
            az_enc = az + unit * az_enc / (np.cos(el) if on_sky else 1.0)
            el_enc = el + unit * el_enc
        else:
            az_enc, el_enc, scale = _set_right(az_enc, el_enc, self.encoders)
            if 'folded' in self.encoders:
                el_enc = np.where(np.cos(az_enc - az) < 0.0, np.pi - el_enc, el_enc)
            if 'synced' in self.encoders:
                az_enc, el_enc = (one + np.cumsum(wrap(read - one))
                                  for one, read in ((az, az_enc), (el, el_enc)))
            if 'sideless' in self.encoders:
                az_enc, el_enc = through_pole(az_enc, el_enc, np.sin(az) < 0.0)
        return Places(az, el, az_enc, el_enc, scale * np.abs(reach) * np.ones(len(az)))

    def _from_ascension(self, az, az_enc, el_enc, lst, sidereal):
        """Hour angles of both pairs; an unknown clock zero is taken from the difference of both."""
        both = [lst - az if 'ascension' in self.catalogue else az,
                lst - az_enc if 'ascension' in self.encoders else az_enc]
        away = both[1] - both[0] - np.where(is_beyond(el_enc), np.pi, 0.0)
        if sidereal or 'ascension' in self.catalogue and 'ascension' in self.encoders:
            return both
        zero = np.angle(np.exp(1j * away).mean())
        if 'ascension' in self.catalogue:
            return both[0] + zero, both[1]
        return both[0], both[1] - zero

    def text(self, zero=0.0, names=ALTAZ.names):
        """Description for users.

        Parameters
        ----------
        zero : float
            Fitted azimuth zero, radians.
        names : mount_kinds.MountKind
        """
        of_azimuths = names is ALTAZ.names
        words = {'a': names.axes[0], 'e': names.axes[1],
                 'd': 'zenith distance' if of_azimuths else 'polar distance'}
        south = of_azimuths and abs(np.remainder(zero, 2.0 * np.pi) - np.pi) < SOUTH
        parts, reversed_here = [], False
        for name in dict.fromkeys((*self.catalogue, *self.encoders)):
            where = (_BOTH if name in self.catalogue and name in self.encoders
                     else _CATALOGUE if name in self.catalogue else _ENCODERS)
            text = _MISTAKES[name][0].format(of=where, **words)
            if name == 'ascension' and where == _ENCODERS:
                text += ' (call the column ra_enc_deg, with time and longitude)'
            if name == 'reversed' and where != _BOTH:
                reversed_here = True
                if south:
                    text = f'azimuth {where} counted from the south through east'
            parts.append(text)
        if self.given:
            parts.append(_GIVEN[self.given][0].format(**words))
        if self.offsets:
            parts.append(f"offsets in place of the encoders' readings, in {self.offsets}")
        if self.exchanged:
            parts.append('mount and catalogue exchanged')
        if south and not reversed_here and not self.offsets and not self.given:
            parts.append('azimuth of one of the two pairs counted from the south')
        if not parts:
            turn = np.degrees(wrap(zero))
            return f'an {words["a"]} zero of {turn:.1f} deg taken off'
        return ', and '.join(parts)


#: the mirror image of a mount
MIRRORED = Reading(('reversed',), ('reversed',))
#: its mirror image in the second angle, equivalent except for gravity and the horizon
NEGATED = Reading(('negative',), ('negative',))
#: readings that differ by signs only, which no run can distinguish
SIGNS = (MIRRORED, NEGATED, Reading(exchanged=True))
#: an azimuth zero this close to half a turn means azimuth counted from the south, radians
SOUTH = 1.5 * DEG


def in_range(names, az, el):
    """Whether the numbers of a pair are in the range of the units of a reading.

    Parameters
    ----------
    names : tuple of str
        Mistakes of the pair in this reading.
    az, el : ndarray, shape (n,)
        As written, converted from degrees to radians.
    """
    if 'swapped' in names:
        az, el = el, az
    az, el = az / DEG, el / DEG
    widest = max(np.abs(az).max(), np.abs(el).max())
    return not (
        'arcseconds' in names and widest < 720.0 or 'arcminutes' in names and widest < 360.0
        or 'gradians' in names and not (np.abs(az).max() <= 400.5 and np.abs(el).max() <= 300.5)
        or 'radians' in names and widest > 2.0 * np.pi
        or 'radians of the first' in names and np.abs(az).max() > 2.0 * np.pi
        or 'hours' in names and not (az.max() <= 24.5 and az.min() >= -12.5))


def without_signs(alike, names=ALTAZ.names):
    """Equally good readings, without those that differ by signs only, which no run can confirm.

    Parameters
    ----------
    alike : sequence of str
        See `mistaken_columns.ColumnCheck.alike`.
    names : mount_kinds.MountKind

    Returns
    -------
    list of str
    """
    signs = {one.text(names=names) for one in SIGNS}
    return [text for text in alike if text not in signs]


def _set_right(a, e, mistakes):
    scale = 1.0
    for name in mistakes:
        _, work, gains = _MISTAKES[name]
        if work is not None:
            a, e = work(a, e)
        scale *= gains[0] * gains[1]
    return a, e, scale


def _joined(*readings):
    """Reading with the mistakes of both; None where they exclude each other."""
    one, other = readings
    for pair in ('catalogue', 'encoders'):
        if set(getattr(one, pair)) & set(getattr(other, pair)):
            return None
    kinds = [set(r.catalogue) | set(r.encoders) for r in readings]
    if kinds[0] & kinds[1] or all(kind & set(_UNITS) for kind in kinds) or any(
            r.exchanged for r in readings) or any(
            getattr(one, what) and getattr(other, what) for what in ('offsets', 'given')) or any(
            a.offsets and b.encoders for a, b in (readings, readings[::-1])):
        return None
    order = list(_MISTAKES)
    return Reading(*(tuple(sorted((*getattr(one, pair), *getattr(other, pair)), key=order.index))
                     for pair in ('catalogue', 'encoders')), one.offsets or other.offsets,
                   given=one.given or other.given)


def single_readings(held=False, mount=ALTAZ, lst=False):
    """All readings with one mistake.

    Parameters
    ----------
    held : bool
        See `Reading.places`.
    mount : Mount
    lst : bool
        Whether the sidereal time is known.

    Returns
    -------
    list of Reading
    """
    if held:
        return [*(Reading(given=name) for name in _GIVEN),
                *(Reading((name,)) for name in _OF_PAIRS)]
    pairs = (*_OF_PAIRS, *(['ascension'] if lst and mount.celestial else []))
    out = [Reading(*pair) for name in pairs
           for pair in (((name,), ()), ((), (name,)), ((name,), (name,)))]
    out.append(Reading((), ('synced',)))
    if not mount.vertical:
        out += [Reading((), (name,)) for name in ('unturned', 'folded', 'sideless')]
    return [*out, *(Reading(offsets=name) for name in _OFFSETS), Reading(exchanged=True)]


def double_readings(held=False, mount=ALTAZ, lst=False):
    """All readings with two compatible mistakes; parameters as in `single_readings`."""
    pairs = (_joined(a, b) for a, b in combinations(single_readings(held, mount, lst), 2))
    return [reading for reading in pairs if reading is not None]
