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

"""First-order pointing terms of a mount, by the names of the field (TPOINT).

A term is a pair of design columns (x, y): its contribution to encoder - catalogue on the sky for
a coefficient of one radian. x = delta-A cos E and y = delta-E, with the axis angles A and E of the
catalogue place (see `mounts`; for an alt-azimuth mount azimuth from north through east, and
elevation). Terms of the axes have the same columns on every mount, under its own names. Terms of
gravity and refraction act toward the zenith, whatever its direction in the axis frame.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .mount_kinds import KINDS
from .mounts import ALTAZ, OF_MOUNT, sides

#: A column that is zero everywhere; the fit detects it by identity and skips it.
ZERO = 0.0


class Trig:
    """Sines and cosines of a direction, computed once for all terms.

    Parameters
    ----------
    az, el : float or ndarray
        Catalogue place by the axes of the mount, radians.
    mount : Mount, optional
        If its errors act on the sky, the angles are folded back to the sky, `mount` is the same
        mount with errors of the mount, and `side` is the sign of on-sky offsets along the angles
        (None for other mounts).
    """

    def __init__(self, az, el, mount=ALTAZ):
        self.side = None
        if mount.on_sky:
            az, el, self.side = sides(az, el)
            mount = mount.with_errors(OF_MOUNT)
        self.az, self.el, self.mount = az, el, mount
        self.sin_az, self.cos_az = np.sin(az), np.cos(az)
        self.sin_el, self.cos_el = np.sin(el), np.cos(el)

    @functools.cached_property
    def zenith(self):
        """The same for azimuth and elevation, whatever the axes are."""
        if self.mount.vertical:
            return self
        return Trig(*self.mount.horizon_of(self.az, self.el))

    def columns(self, term):
        """Columns (x, y) of a `Term` along the axes of the mount."""
        x, y = term.of(self)
        if self.side is None:
            return x, y
        return tuple(v if v is ZERO else self.side * v for v in (x, y))

    def lifted(self, by):
        """Columns (x, y) of a displacement of the line of sight toward the zenith by `by`."""
        if self.mount.vertical:
            return ZERO, by
        x, y, z = self.mount.zenith
        up = (x * self.cos_az - y * self.sin_az,
              z * self.cos_el - self.sin_el * (x * self.sin_az + y * self.cos_az))
        # its length is cos E; at the zenith itself the direction is undefined
        by = by / np.maximum(np.hypot(*up), 1e-12)
        return by * up[0], by * up[1]


@dataclass(frozen=True)
class Term:
    """One pointing term.

    Attributes
    ----------
    name : str
        Name of the coefficient in this project.
    doc : str
        Description.
    formula : str
        Its columns (x, y).
    tpoint_sign : int or None
        Our coefficient = ``tpoint_sign`` x TPOINT's coefficient of the same name; None if
        TPOINT has no such term. TPOINT's corrections go from encoder to star, and its internal
        azimuth is zero in the south and 90 degrees in the east: hence the signs.
    of : callable
        `Trig` -> (x, y); `ZERO` for a column that is zero everywhere.
    """

    name: str
    doc: str
    formula: str
    tpoint_sign: int | None
    of: Callable


#: name -> `Term`
TERMS = {row[0]: Term(*row) for row in (
    ('IA', 'azimuth index', '(cos E, 0)', 1, lambda t: (t.cos_el, ZERO)),
    ('IE', 'elevation index', '(0, 1)', -1, lambda t: (ZERO, 1.0)),
    ('CA', 'collimation, positive where the line of sight is left of the tube', '(1, 0)', 1,
     lambda t: (1.0, ZERO)),
    ('NPAE', 'elevation axis not perpendicular to the azimuth axis, its right end high',
     '(sin E, 0)', 1, lambda t: (t.sin_el, ZERO)),
    ('AN', 'azimuth axis tilted north', '(sin A sin E, cos A)', 1,
     lambda t: (t.sin_az * t.sin_el, t.cos_az)),
    ('AW', 'azimuth axis tilted west', '(cos A sin E, -sin A)', 1,
     lambda t: (t.cos_az * t.sin_el, -t.sin_az)),
    ('TF', 'tube flexure, cos E', '(0, cos E)', 1, lambda t: t.lifted(t.zenith.cos_el)),
    ('TX', 'flexure or refraction constant, cot E', '(0, cot E)', 1,
     lambda t: t.lifted(t.zenith.cos_el / t.zenith.sin_el)),
    ('TX3', 'third order of the refraction, cot^3 E', '(0, cot^3 E)', None,
     lambda t: t.lifted((t.zenith.cos_el / t.zenith.sin_el) ** 3)),
    ('ECES', 'elevation encoder centring, sin E', '(0, sin E)', -1, lambda t: (ZERO, t.sin_el)),
    ('HECE2', 'elevation, cos 2E', '(0, cos 2E)', -1, lambda t: (ZERO, np.cos(2 * t.el))),
    ('HESE2', 'elevation, sin 2E', '(0, sin 2E)', -1, lambda t: (ZERO, np.sin(2 * t.el))),
    ('ACEC', 'azimuth encoder centring, cos A', '(cos A cos E, 0)', -1,
     lambda t: (t.cos_az * t.cos_el, ZERO)),
    ('ACES', 'azimuth encoder centring, sin A', '(sin A cos E, 0)', 1,
     lambda t: (t.sin_az * t.cos_el, ZERO)),
    ('HACA2', 'azimuth encoder, cos 2A', '(cos 2A cos E, 0)', 1,
     lambda t: (np.cos(2 * t.az) * t.cos_el, ZERO)),
    ('HASA2', 'azimuth encoder, sin 2A', '(sin 2A cos E, 0)', -1,
     lambda t: (np.sin(2 * t.az) * t.cos_el, ZERO)),
    ('HECA', 'elevation nod, cos A', '(0, cos A)', 1, lambda t: (ZERO, t.cos_az)),
    ('HESA', 'elevation nod, sin A', '(0, sin A)', -1, lambda t: (ZERO, t.sin_az)),
    ('HECA2', 'elevation nod, cos 2A', '(0, cos 2A)', -1, lambda t: (ZERO, np.cos(2 * t.az))),
    ('HESA2', 'elevation nod, sin 2A', '(0, sin 2A)', 1, lambda t: (ZERO, np.sin(2 * t.az))),
    ('HVCA2', 'azimuth axis wobble across the line of sight, cos 2A', '(cos 2A sin E, 0)', 1,
     lambda t: (np.cos(2 * t.az) * t.sin_el, ZERO)),
    ('HVSA2', 'azimuth axis wobble across the line of sight, sin 2A', '(sin 2A sin E, 0)', -1,
     lambda t: (np.sin(2 * t.az) * t.sin_el, ZERO)),
)}

#: The geometry of an alt-az mount and Hooke's law flexure.
PHYSICAL = ALTAZ.names.physical

#: The usual six for telescopes with well squared axes.
STANDARD6 = ALTAZ.names.standard6


def _same(name, own, doc, formula, tpoint_sign, sign=1):
    """A term of another mount with the columns of an alt-az term, in its own axes."""
    of = TERMS[own].of
    if sign > 0:
        return Term(name, doc, formula, tpoint_sign, of)
    return Term(name, doc, formula, tpoint_sign, lambda t: tuple(-v for v in of(t)))


def _rotations(kind, docs):
    """Geometric terms of a kind of mount; their columns follow from the geometry."""
    out = []
    for (name, (own, sign)), (doc, formula, tpoint_sign) in zip(KINDS[kind].terms.items(), docs):
        out.append(_same(name, own, doc, formula, tpoint_sign, sign))
    return out


_UP = 'upward'  # in formulas: toward the zenith
_ZENITH = [
    _same('TX', 'TX', TERMS['TX'].doc, f'cot E {_UP}', 1),
    _same('TX3', 'TX3', TERMS['TX3'].doc, f'cot^3 E {_UP}', None),
    Term('HZCZ', 'second flexure, sin E', f'sin E {_UP}', 1,
         lambda t: t.lifted(t.zenith.sin_el))]
#: signs: TPOINT's corrections go from encoder to star in hour angle and declination; its gravity
#: terms point down
_HADEC = [*_rotations('equatorial', (
    ('hour angle index', '(cos δ, 0)', -1), ('declination index', '(0, 1)', -1),
    ('collimation, the line of sight not square to the declination axis', '(1, 0)', -1),
    ('declination axis not perpendicular to the polar axis', '(sin δ, 0)', -1),
    ('polar axis tilted west of the pole, seen from below', '(-cos h sin δ, sin h)', -1),
    ('polar axis tilted in the meridian: too high in the north', '(sin h sin δ, cos h)', -1),
    ('tube flexure, cos E', f'cos E {_UP}', 1))), *_ZENITH,
    Term('FO', 'fork flexure', '(0, cos h)', -1, lambda t: (ZERO, t.cos_az)),
    Term('DAF', 'flexure of the declination axis or its cantilever', '(-sin E, 0)', -1,
         lambda t: (-t.zenith.sin_el, ZERO)),
    *(_same(name, own, doc, formula, -1) for name, own, doc, formula in (
        ('HCEC', 'ACEC', 'hour angle encoder centring, cos h', '(cos h cos δ, 0)'),
        ('HCES', 'ACES', 'hour angle encoder centring, sin h', '(sin h cos δ, 0)'),
        ('DCES', 'ECES', 'declination encoder centring, sin δ', '(0, sin δ)'),
        ('HHCH2', 'HACA2', 'hour angle encoder, cos 2h', '(cos 2h cos δ, 0)'),
        ('HHSH2', 'HASA2', 'hour angle encoder, sin 2h', '(sin 2h cos δ, 0)'),
        ('HDCD2', 'HECE2', 'declination, cos 2δ', '(0, cos 2δ)'),
        ('HDSD2', 'HESE2', 'declination, sin 2δ', '(0, sin 2δ)'),
        ('HDCH', 'HECA', 'declination nod, cos h', '(0, cos h)'),
        ('HDSH', 'HESA', 'declination nod, sin h', '(0, sin h)'),
        ('HDCH2', 'HECA2', 'declination nod, cos 2h', '(0, cos 2h)'),
        ('HDSH2', 'HESA2', 'declination nod, sin 2h', '(0, sin 2h)'),
        ('HPCH2', 'HVCA2', 'polar axis wobble, cos 2h', '(cos 2h sin δ, 0)'),
        ('HPSH2', 'HVSA2', 'polar axis wobble, sin 2h', '(sin 2h sin δ, 0)'))),
    Term('DCEC', 'declination encoder centring, cos δ', '(0, cos δ)', -1,
         lambda t: (ZERO, t.cos_el))]
#: for mounts that are neither alt-azimuth nor equatorial
_ANYWHERE = (
    ('index of the {0}', '(cos {b}, 0)', None), ('index of the {1}', '(0, 1)', None),
    ('collimation, positive where the line of sight is left of the tube', '(1, 0)', None),
    ('{1} not perpendicular to the {0}, its right end high', '(sin {b}, 0)', None),
    ('{0} tilted to its angle 0', '(sin {a} sin {b}, cos {a})', None),
    ('{0} tilted to its angle -90 degrees', '(cos {a} sin {b}, -sin {a})', None),
    ('tube flexure, cos E', f'cos E {_UP}', None))
_HADEC = {term.name: term for term in _HADEC}


@functools.lru_cache
def _elsewhere(kind, names):
    """Terms of a mount that is neither vertical nor celestial; `names` are its term names."""
    first, second = KINDS[kind].shafts
    a, b = KINDS[kind].letters
    docs = [tuple(text and text.format(first, second, a=a, b=b) for text in row)
            for row in _ANYWHERE]
    return {term.name: term for term in [*_rotations(kind, docs), *_ZENITH]}


def terms_of(mount):
    """All terms of a mount or of a kind of mount: name -> `Term`."""
    kind = mount if isinstance(mount, str) else mount.kind
    names = KINDS[kind]
    return TERMS if names.vertical else _HADEC if names.celestial else _elsewhere(
        kind, tuple(names.terms))


#: likely cause and what to check, by the term names of alt-azimuth mounts
_CAUSES = {
    'IA': ('zero of the {first} encoder off', 'zero of the {first} encoder'),
    'IE': ('zero of the {second} encoder off', 'zero of the {second} encoder'),
    'CA': ('tube, mirror or camera not square to the {second} axis',
           'shims of the tube; mirror and camera in it'),
    'NPAE': ('{second} axis not square to the {first} axis',
             'height of the bearings of the {second} axis'),
    'TF': ('flexure of the tube under its weight', 'stiffness of the tube and of the mirror cell'),
    'TX': ('refraction, or flexure that grows toward the horizon',
           'pressure and temperature for the refraction')}
#: the same for tilts of the first axis, by where it points
_TILTS = {'zenith': ('base not level', 'feet and pier: level of the base'),
          'celestial': ('polar axis off the pole', 'bolts of the polar axis')}


def term_cause(name, mount):
    """Likely mechanical cause of a term.

    Parameters
    ----------
    name : str
        One of `terms_of` the mount.
    mount : Mount

    Returns
    -------
    cause, check : str
        Likely cause, and what to check; '' where no single part is known.
    """
    kind = KINDS[mount.kind]
    own, _ = kind.terms.get(name, (name, 1))
    if own in ('AN', 'AW'):
        return _TILTS.get(kind.pole, (f'{kind.shafts[0]} tilted', 'its bearings and base'))
    cause, check = _CAUSES.get(own, (terms_of(mount)[name].doc, ''))
    return tuple(text.format(first=kind.axes[0], second=kind.axes[1]) for text in (cause, check))


def known_terms(names, mount=ALTAZ):
    """The `Term` of each name.

    Parameters
    ----------
    names : iterable of str
    mount : Mount, optional

    Returns
    -------
    list of Term

    Raises
    ------
    ValueError
        A name is unknown or given twice.
    """
    return list(_known_terms(tuple(names), mount))


@functools.lru_cache(256)  # three calls a fit, and one for every model made
def _known_terms(names, mount):
    known = terms_of(mount)
    unknown = [name for name in names if name not in known]
    if unknown:
        raise ValueError(
            f'unknown pointing term {", ".join(map(str, unknown))}'
            + ('' if mount.vertical else f' of {mount.names.words}')
            + f'; choose from {", ".join(known)}')
    if len(set(names)) < len(names):
        raise ValueError(f'a pointing term is named twice in {", ".join(names)}; name it once')
    return tuple(known[name] for name in names)


def stacked_design(names, az, el, mount=ALTAZ, trig=None):
    """Design of both axes in one array, one row per term: x of all stars, then y of all stars.

    Contiguous rows make the matrix products of the fit fast.

    Parameters
    ----------
    names : sequence of str, length k
    az, el : ndarray, shape (n,)
        Catalogue place by the axes of the mount, radians.
    mount : Mount, optional
    trig : Trig, optional
        Trigonometric functions of these places, if already computed.

    Returns
    -------
    ndarray, shape (k, 2n)

    Raises
    ------
    ValueError
        A name is unknown or given twice.
    """
    terms = known_terms(names, mount)
    n = len(az)
    trig = Trig(az, el, mount) if trig is None else trig
    out = np.empty((len(terms), 2 * n))
    for x_row, y_row, term in zip(out[:, :n], out[:, n:], terms):
        x_row[:], y_row[:] = trig.columns(term)
    return out


def design(names, az, el, mount=ALTAZ):
    """First-order design matrices.

    Parameters
    ----------
    names : sequence of str, length k
    az, el : ndarray, shape (n,)
        Catalogue place by the axes of the mount, radians.
    mount : Mount, optional

    Returns
    -------
    x, y : ndarray, shape (n, k)
        On-sky offset (encoder - catalogue) for unit coefficients.

    Raises
    ------
    ValueError
        A name is unknown or given twice.
    """
    az, el = np.broadcast_arrays(np.atleast_1d(az), np.atleast_1d(el))
    both = stacked_design(names, az, el, mount)
    return both[:, : len(az)].T, both[:, len(az):].T


def mean_columns(names, az, el, mount=ALTAZ):
    """Mean derivatives of the encoder angles over some rows, such as exposures of Polaris.

    Parameters
    ----------
    names : sequence of str, length k
    az, el : ndarray, shape (n,)
        Catalogue place by the axes of the mount, radians.
    mount : Mount, optional

    Returns
    -------
    ndarray, shape (2, k)
        Derivatives of azimuth (coordinate angle, not on the sky) and elevation by the coefficients.
    """
    x, y = design(names, az, el, mount)
    return np.stack((np.mean(x / np.cos(el)[:, None], axis=0), np.mean(y, axis=0)))
