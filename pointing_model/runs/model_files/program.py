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

"""Description of a program with pointing models, and functions shared by their readers."""

import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from pointing_model.model import PointingModel
from pointing_model.mounts import ALTAZ, Mount

from .term_columns import KEY_TERMS, summed


@dataclass(frozen=True)
class Program:
    """A program that reads pointing models.

    Attributes
    ----------
    name : str
        Value of ``--to``.
    title : str
        Name for people.
    own : callable
        column -> list of (the program's term, its coefficient for a unit of ours), or None if it
        has no such term.
    column : callable
        The program's term -> list of (column, our value for a unit of theirs).
    candidates : tuple
        Columns that a refit may add to those of the model.
    encoder : callable
        ``(values, az, el)``, values by column -> encoder azimuth and elevation that the program
        computes, radians.
    write : callable
        `Sheet` -> text of the file.
    read : callable
        ``(path, text)`` -> `ModelFile`.
    looks_like : callable
        Text -> true if it is such a file.
    geometry : {'rotation', 'first_order', None}
        Geometry of our model that is the same as the program's; None: neither, ours is fitted.
    plain : tuple of str
        Terms whose coefficient is not an angle.
    whole : float
        Coefficients are whole multiples of this, radians; 0: rounding is negligible.
    otherwise : tuple of (str, callable)
        Other readers of the same file that compute something else: description, and a callable
        like `encoder`.
    mount : Mount
        Mount whose axis angles `encoder` takes and returns.
    for_mount : callable, optional
        Mount -> the same program with the terms of that mount; None: alt-azimuth mounts only.
    one_sided : bool
        Whether its file has one model for both pier sides, applied on the sky.
    """

    name: str
    title: str
    own: Callable
    column: Callable
    candidates: tuple
    encoder: Callable
    write: Callable
    read: Callable
    looks_like: Callable
    geometry: str | None
    plain: tuple = ()
    whole: float = 0.0
    otherwise: tuple = ()
    mount: Mount = ALTAZ
    for_mount: Callable | None = None
    one_sided: bool = False


@dataclass
class ModelFile:
    """Contents of a model file.

    Attributes
    ----------
    terms : dict of str to float
        Coefficients by the program's names, radians (plain numbers if not angles).
    sigma : dict of str to float
        Standard errors, if the file has them.
    notes : list of str
    """

    terms: dict
    sigma: dict = field(default_factory=dict)
    notes: list = field(default_factory=list)


@dataclass
class Sheet:
    """Data that a model file is written from.

    Attributes
    ----------
    terms, sigma : dict of str to float
        Coefficients and standard errors by the program's names, radians.
    caption : str
        One line.
    observations : int
        Number of observations, 0 if unknown.
    rms_arcsec : float
        Of the fit, 0 if unknown.
    site : pair of float, optional
        Latitude and longitude, radians, north and east positive.
    beyond : bool, optional
        Pier side of the file for a German mount: through the pole or not; None: both.
    """

    terms: dict
    sigma: dict
    caption: str
    observations: int = 0
    rms_arcsec: float = 0.0
    site: tuple | None = None
    beyond: bool | None = None


def spread(count, low, high=0.5 * np.pi):
    """Azimuths and elevations spread evenly over the sky between two elevations, radians."""
    i = np.arange(count)
    height = np.sin(low) + (np.sin(high) - np.sin(low)) * (i + 0.5) / count
    return np.mod(i * np.pi * (3.0 - np.sqrt(5.0)), 2.0 * np.pi), np.arcsin(height)


def first_order(values, az, el, mount=ALTAZ):
    """Encoder angles of a sum of columns at the catalogue place."""
    x, y = summed(values, az, el, mount)
    return az + x / np.cos(el), el + y


def first_order_at_encoder(values, az, el, mount=ALTAZ):
    """Like `first_order`, with the columns evaluated at the encoder angles."""
    a, e = np.asarray(az, float), np.asarray(el, float)
    for _ in range(20):  # each pass reduces the error by a factor of the terms' size in radians
        x, y = summed(values, a, e, mount)
        a, e = az + x / np.cos(e), el + y
    return a, e


def rotations(values, az, el, mount=ALTAZ):
    """Encoder angles of a sum of columns, with the geometric terms as rotations."""
    return model_of(values, {}, 'rotation', mount=mount).sky_to_encoder(az, el)


def model_of(values, sigma, geometry, provenance=None, mount=ALTAZ):
    """Our `PointingModel` of a sum of columns.

    Parameters
    ----------
    values, sigma : dict of tuple to float
        Value and standard error of each column, radians.
    geometry : {'rotation', 'first_order'}
    provenance : dict, optional
    mount : Mount, optional

    Returns
    -------
    PointingModel
        Columns that are not terms of ours become its effects.
    """
    from pointing_model.effects import effect
    from pointing_model.fitted_effects import FittedEffect

    if not mount.vertical:
        return PointingModel({key[0]: value for key, value in values.items()}, np.diag(np.square(
            [sigma.get(key, 0.0) for key in values])), None, provenance or {}, geometry, (), mount)
    terms = {KEY_TERMS[key]: value for key, value in values.items() if key in KEY_TERMS}
    errors = [sigma.get(key, 0.0) for key in values if key in KEY_TERMS]
    effects = [FittedEffect(effect('product', result=key[0], factors=[list(f) for f in key[1]]),
                            [value], [sigma.get(key, 0.0)])
               for key, value in values.items() if key not in KEY_TERMS]
    return PointingModel(terms, np.diag(np.square(errors)), None, provenance or {}, geometry,
                         effects)


# ------------------------------------------------------------------------------- reading of files

def for_celestial(program, mount, terms, **changes):
    """A program with the terms of an equatorial mount.

    Parameters
    ----------
    program : Program
    mount : Mount
    terms : dict of str to (str, int)
        The program's name -> our term, and our value for a unit of theirs.
    **changes
        Other attributes of `Program` to replace.

    Returns
    -------
    Program

    Raises
    ------
    ValueError
        The mount is not equatorial.
    """
    if not mount.celestial:
        raise ValueError(f'{program.title} has no models of {mount.names.words}')
    own = {(term, ()): [(name, float(sign))] for name, (term, sign) in terms.items()}
    return replace(program, own=own.get, candidates=tuple(own), mount=mount,
                   column=lambda name: [((terms[name][0], ()), float(terms[name][1]))], **changes)


EQUATORIAL = re.compile(r'I[HD]|CH|NP|M[AE]|FO|DA[FB]|[HD]CE[CS]|P[HDX]\w+|H[HDXP][SC]\w+')


def number_of(path, line, name, text):
    """A finite number from text; otherwise a ValueError with file and line."""
    try:
        value = float(text)
    except ValueError:
        raise ValueError(f'{path}, row {line}: {name} is {text[:40]!r}, which is no '
                         'number') from None
    if not np.isfinite(value):
        raise ValueError(f'{path}, row {line}: {name} is {text[:40]!r}, which is not finite')
    return value


def refuse_equatorial(path, names):
    """Raise a ValueError if terms belong to an equatorial mount."""
    found = [name for name in names if EQUATORIAL.fullmatch(name)]
    if found:
        raise ValueError(f'{path} is a model of an equatorial mount ({", ".join(found[:8])}), and '
                         'not of an alt-azimuth one; if the mount is one, say so (--mount, '
                         '--latitude)')
