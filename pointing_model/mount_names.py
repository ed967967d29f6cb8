"""What the axes of a kind of mount, and what is wrong with them, are called."""

import re
from dataclasses import dataclass
from functools import cached_property

#: the terms of the rotations, by the names that an alt-azimuth mount has for them
CANONICAL = ('IA', 'IE', 'CA', 'NPAE', 'AN', 'AW', 'TF')
_AXES = ('azimuth', 'elevation')
_WORDS = re.compile(r'\b(?:azimuth|elevation)\b')


@dataclass(frozen=True)
class Names:
    """What the axes of a kind of mount and its terms are called.

    Attributes
    ----------
    axes : tuple of str
        Their angles, for people.
    shafts : tuple of str
        The axes themselves, for people.
    letters : tuple of str
        Of the angles in formulas.
    tpoint : tuple of str
        In names of TPOINT's generic terms: of both angles, of what is left and right as a third
        term of the geometry is (non-perpendicularity), and of left and right on the sky. Empty
        where TPOINT has no such mount.
    columns : tuple of str
        In the names of columns in files: ``az_enc_deg``, ``ha_enc_deg``.
    terms : dict of str to (str, int)
        Name of each geometric term -> that of the same rotation of an alt-azimuth mount, and its
        sign there: MA leans the pole to the x of the frame (west), AW away from it.
    sides : tuple of tuple of str
        Words for a falling and a rising angle, of each axis.
    """

    axes: tuple
    shafts: tuple
    letters: tuple
    tpoint: tuple
    columns: tuple
    terms: dict
    sides: tuple

    @cached_property
    def keys(self):
        """Of the axes, in names of effects and drivers."""
        return tuple(axis.replace(' ', '_') for axis in self.axes)

    @property
    def physical(self):
        """The geometry and Hooke's law flexure."""
        return tuple(self.terms)

    @property
    def standard6(self):
        """The usual six, of telescopes with well squared axes."""
        return tuple(name for name, (own, _) in self.terms.items() if own != 'NPAE')

    @property
    def index(self):
        """The zeros of both axes."""
        return self.physical[:2]

    def named(self, canonical):
        """Name here of a term of `CANONICAL`."""
        return next(name for name, (own, _) in self.terms.items() if own == canonical)

    def say(self, text):
        """A sentence about azimuth and elevation, of the axes of this mount."""
        if self.axes == _AXES:
            return text
        return _WORDS.sub(lambda found: self.axes[_AXES.index(found[0])], text)

    def word(self, axis):
        """For people, of ``az`` (the first axis) or ``el`` (the second)."""
        return self.axes[axis != 'az']

    def shaft(self, axis):
        """As `word`, of the axis itself."""
        return self.shafts[axis != 'az']

    def key(self, axis):
        """As `word`, in names."""
        return self.keys[axis != 'az']

    def letter(self, axis):
        """As `word`, in formulas."""
        return self.letters[axis != 'az']


def _terms(*names):
    return {name: (own, 1) for name, own in zip(names, CANONICAL)}


_ALTAZ = Names(_AXES, ('azimuth axis', 'elevation axis'), ('A', 'E'),
               ('A', 'E', 'V', 'S'), ('az', 'el'), _terms(*CANONICAL),
               (('anticlockwise', 'clockwise'), ('downward', 'upward')))
_HADEC = Names(('hour angle', 'declination'), ('polar axis', 'declination axis'), ('h', 'δ'),
               ('H', 'D', 'P', 'X'), ('ha', 'dec'),
               {**_terms('IH', 'ID', 'CH', 'NP'), 'MA': ('AW', -1), 'ME': ('AN', 1),
                'TF': ('TF', 1)},
               (('eastward', 'westward'), ('toward smaller readings', 'toward larger readings')))
_FREE = Names(('first axis', 'second axis'), ('first axis', 'second axis'), ('a', 'b'), (),
              ('axis1', 'axis2'),
              _terms('I1', 'I2', 'C1', 'N12', 'T1', 'T2', 'TF'),
              (('falling', 'rising'), ('falling', 'rising')))
#: kind -> what its axes and terms are called. A German mount is an equatorial one that goes
#: through the pole to change its side; the geometry is the same
KINDS = {'altaz': _ALTAZ, 'equatorial': _HADEC, 'german': _HADEC, 'free': _FREE}
