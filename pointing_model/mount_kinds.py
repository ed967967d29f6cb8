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

"""Kinds of mounts: names of axes and terms, orientation, travel and what they carry.

A new kind is a new entry of `KINDS`. Other code asks a mount, or its kind, for its properties,
never for its name.
"""

import re
from dataclasses import dataclass, replace
from functools import cached_property

#: terms of the rotations, by their names on an alt-azimuth mount
CANONICAL = ('IA', 'IE', 'CA', 'NPAE', 'AN', 'AW', 'TF')
_AXES = ('azimuth', 'elevation')
_WORDS = re.compile(r'\b(?:azimuth|elevation)\b')


@dataclass(frozen=True)
class MountKind:
    """A kind of mount.

    Attributes
    ----------
    words : str
        For people: "an alt-azimuth mount".
    axes : tuple of str
        Names of their angles, for people.
    shafts : tuple of str
        Names of the axes themselves, for people.
    letters : tuple of str
        Symbols of the angles in formulas.
    tpoint : tuple of str
        Letters in names of TPOINT's generic terms: for both angles, for left-right as the
        third term of the geometry (non-perpendicularity), and for left-right on the sky. Empty
        if TPOINT has no such mount.
    columns : tuple of str
        Prefixes of columns in files: ``az_enc_deg``, ``ha_enc_deg``.
    terms : dict of str to (str, int)
        Name of each geometric term -> name of the same rotation on an alt-azimuth mount, and
        the relative sign: MA tilts the pole to the x of the frame (west), AW away from it.
    sides : tuple of tuple of str
        Words for decreasing and increasing angle, for each axis.
    pole : str or tuple of float
        Direction of the first axis: ``'zenith'``; ``'celestial'``, which needs the latitude;
        ``'given'`` with the mount; or azimuth, elevation and roll, radians, where the azimuth
        may still be given with the mount.
    travel_deg : tuple of tuple of float
        Default travel of both axes, in the north.
    park_deg : str
        Park position of mounts with a server: near the pole, but not at it, where a place does
        not determine the first axis.
    two_sided : bool
        Whether it goes through the pole to change sides, as a German mount does to keep its
        counterweight down.
    geared : bool
        Whether most have no encoder on the axis: the motor is counted, and the worm wheel takes
        the place of the encoder disc.
    ring : bool
        Whether the first axis may be a large ring, which its own weight deforms to an oval.
    carrier, carriers : str
        What the first axis carries, in short, and the kinds of it.
    usual : tuple of tuple of str
        Groups of common terms: alternatives to mistaken columns as explanation of a misfit.
    aliases : tuple of str
        Other names.
    """

    words: str
    axes: tuple
    shafts: tuple
    letters: tuple
    tpoint: tuple
    columns: tuple
    terms: dict
    sides: tuple
    pole: object
    travel_deg: tuple
    park_deg: str = '0,80'
    two_sided: bool = False
    geared: bool = False
    ring: bool = False
    carrier: str = 'fork'
    carriers: str = 'fork or saddle'
    usual: tuple = ()
    aliases: tuple = ()

    @property
    def vertical(self):
        """Whether the first axis points to the zenith: its frame is the horizon."""
        return self.pole == 'zenith'

    @property
    def celestial(self):
        """Whether the first axis points to the celestial pole."""
        return self.pole == 'celestial'

    @cached_property
    def keys(self):
        """Names of the axes in effects and drivers."""
        return tuple(axis.replace(' ', '_') for axis in self.axes)

    @property
    def physical(self):
        """The terms of the geometry, and Hooke's law flexure."""
        return tuple(self.terms)

    @property
    def standard6(self):
        """The usual six, for telescopes with well squared axes."""
        return tuple(name for name, (own, _) in self.terms.items() if own != 'NPAE')

    @property
    def index(self):
        """The zero terms of both axes."""
        return self.physical[:2]

    def named(self, canonical):
        """Name on this mount of a term of `CANONICAL`."""
        return next(name for name, (own, _) in self.terms.items() if own == canonical)

    def translate(self, text):
        """Replace azimuth and elevation in a sentence by the axes of this mount."""
        if self.axes == _AXES:
            return text
        return _WORDS.sub(lambda found: self.axes[_AXES.index(found[0])], text)

    def word(self, axis):
        """Name for people of the angle ``az`` (first axis) or ``el`` (second)."""
        return self.axes[axis != 'az']

    def shaft(self, axis):
        """The same as `word`, for the axis itself."""
        return self.shafts[axis != 'az']

    def key(self, axis):
        """The same as `word`, for names in code."""
        return self.keys[axis != 'az']

    def letter(self, axis):
        """The same as `word`, for formulas."""
        return self.letters[axis != 'az']


def _terms(*names):
    return {name: (own, 1) for name, own in zip(names, CANONICAL)}


_HADEC = MountKind(
    'an equatorial mount', ('hour angle', 'declination'), ('polar axis', 'declination axis'),
    ('h', 'δ'), ('H', 'D', 'P', 'X'), ('ha', 'dec'),
    {**_terms('IH', 'ID', 'CH', 'NP'), 'MA': ('AW', -1), 'ME': ('AN', 1), 'TF': ('TF', 1)},
    (('eastward', 'westward'), ('toward smaller readings', 'toward larger readings')),
    'celestial', ((-180.0, 180.0), (-90.0, 100.0)), geared=True, ring=True,
    carrier='fork or saddle', carriers='fork, yoke or horseshoe', usual=(
        ('HZCZ',), ('TX',), ('HDCD2', 'HDSD2'), ('HCEC', 'HCES'), ('HHCH2', 'HHSH2'),
        ('HDCH', 'HDSH'), ('HDCH2', 'HDSH2'), ('HPCH2', 'HPSH2'), ('DAF',)),
    aliases=('fork', 'horseshoe'))
#: default kind, not written to files
USUAL = 'altaz'
#: messages number them in this order: append new ones at the end
KINDS = {
    USUAL: MountKind(
        'an alt-azimuth mount', _AXES, ('azimuth axis', 'elevation axis'), ('A', 'E'),
        ('A', 'E', 'V', 'S'), ('az', 'el'), _terms(*CANONICAL),
        (('anticlockwise', 'clockwise'), ('downward', 'upward')),
        'zenith', ((-270.0, 270.0), (-5.0, 95.0)), '180,80', usual=(
            ('ECES',), ('TX',), ('HECE2', 'HESE2'), ('ACEC', 'ACES'), ('HACA2', 'HASA2'),
            ('HECA', 'HESA'), ('HECA2', 'HESA2'), ('HVCA2', 'HVSA2')),
        aliases=('alt-az',)),
    'equatorial': _HADEC,
    # an equatorial mount that goes through the pole to change sides; the geometry is the same
    'german': replace(_HADEC, words='a German mount', travel_deg=((-10.0, 190.0), (-90.0, 270.0)),
                      park_deg='90,80', two_sided=True, ring=False, carrier='saddle',
                      carriers='saddle', aliases=('gem',)),
    'free': MountKind(
        'a mount of two axes', ('first axis', 'second axis'), ('first axis', 'second axis'),
        ('a', 'b'), (), ('axis1', 'axis2'), _terms('I1', 'I2', 'C1', 'N12', 'T1', 'T2', 'TF'),
        (('falling', 'rising'), ('falling', 'rising')), 'given',
        ((-180.0, 180.0), (-90.0, 270.0)), usual=(('TX',), ('HZCZ',))),
    # alt-alt, for satellite stations: its X axis is level and points north, or as given, and
    # carries the Y axis; at the zenith both are zero; its fast places are at the horizon
    'xy': MountKind(
        'an X/Y (alt-alt) mount', ('x angle', 'y angle'), ('X axis', 'Y axis'), ('X', 'Y'), (),
        ('x', 'y'), _terms('IX', 'IY', 'CXY', 'NXY', 'XE', 'XA', 'TF'),
        (('falling', 'rising'), ('falling', 'rising')), (0.0, 0.0),
        ((-95.0, 95.0), (-85.0, 85.0)), '0,0', carrier='yoke', carriers='yoke or gimbal',
        usual=(('TX',), ('HZCZ',)), aliases=('x/y', 'altalt', 'alt-alt', 'x-y'))}


def kind_of(document):
    """The `MountKind` named in a document of results; an alt-azimuth one by default."""
    return KINDS[document.get('mount') or USUAL]


def kinds_text():
    """How to write the kinds, for people: altaz, equatorial, ..."""
    return ', '.join(name + (':AZ,EL[,ROLL]' if kind.pole == 'given' else '[:AZ]' if isinstance(
        kind.pole, tuple) else '') for name, kind in KINDS.items())
