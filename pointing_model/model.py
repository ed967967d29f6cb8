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

"""The pointing model: fitted terms and harmonics that turn sky into encoder and back."""

from dataclasses import dataclass, field, replace

import numpy as np

from msg_tools.units import ARCSEC, all_finite, wrap

from . import geometry as rotation
from .context import Context
from .fitted_effects import as_context, total
from .harmonics import DEGREE, Harmonics, columns_of, names_of
from .mounts import ALTAZ, Mount, is_beyond
from .pointing_terms import Trig, design, known_terms
from .zero import NO_ZERO

#: smallest effect of an undetermined direction (scaled to a largest term of 1) that counts: a
#: prediction that it changes by more is open (0.1" for terms of 100")
OPEN = 1e-3


def _as_written(value, unit):
    # the value that the document's decimal number gives back, so a round trip is exact to the bit
    return np.asarray(value, float) / unit * unit


@dataclass(frozen=True)
class PointingModel:
    """Pointing offsets of a mount: physical terms, harmonics, and effects of other drivers.

    An effect counts as zero where its driver (time, temperature, approach, ...) is missing from the
    `context` of a call or NaN there: drivers are centred on the run of the fit. Effects of the
    direction alone always act. `unknown` reports which rows lack a driver.

    Parameters
    ----------
    terms : dict of str to float
        Coefficients in radians, by the names of `pointing_terms.terms_of` the mount, in the order
        of `covariance`.
    covariance : ndarray, shape (k, k), optional
        Covariance of the terms, radians^2; zero if omitted.
    harmonics : Harmonics, optional
        Series fitted to the residuals of the terms.
    provenance : dict, optional
        Origin of the model; anything that JSON can hold.
    geometry : {'rotation', 'first_order'}
        Whether the geometric terms (IA IE CA NPAE AN AW TF, or what the mount has for them) act
        as exact rotations or as their first-order columns. All others, the harmonics and the
        effects add their columns at the catalogue place.
    effects : sequence of FittedEffect, optional
    undetermined : sequence of str, optional
        Terms that the stars do not determine. Those with a value other than zero stand for the
        whole degenerate group. They have no standard error.
    directions : sequence of dict of str to float, optional
        Degenerate directions of terms and harmonics: changes that the stars cannot see.
    sides : tuple of int, optional
        German mounts: number of fitted rows on this side of the pier, and on the other.
    joint : ndarray, shape (k + e, k + e), optional
        Joint covariance of the terms and all effect coefficients, radians^2. Without it the
        effects count as independent.
    mount : Mount, optional
        Its axes define all angles of the methods. `Mount.axes_of` converts a place on the horizon
        to them, for either side of the pier.

    Raises
    ------
    ValueError
        An unknown term or geometry, a value that is not finite, or a covariance of wrong shape.
    """

    terms: dict
    covariance: np.ndarray = None
    harmonics: Harmonics | None = None
    provenance: dict = field(default_factory=dict)
    geometry: str = 'rotation'
    effects: tuple = ()
    mount: Mount = ALTAZ
    undetermined: tuple = ()
    directions: tuple = ()
    sides: tuple | None = None
    joint: np.ndarray | None = None

    def __post_init__(self):
        known_terms(self.terms, self.mount)
        object.__setattr__(self, 'effects', tuple(self.effects))
        # a model may have only some of the terms of another: keep what concerns them
        object.__setattr__(self, 'undetermined', tuple(
            name for name in self.undetermined if name in self.terms))
        own = {*self.terms, *(names_of() if self.harmonics is not None else ())}
        directions = ({name: value for name, value in one.items() if name in own}
                      for one in self.directions)
        object.__setattr__(self, 'directions', tuple(filter(None, directions)))
        if self.geometry not in ('rotation', 'first_order'):
            raise ValueError(
                f'unknown geometry {self.geometry!r} of a model; take rotation or first_order')
        k = len(self.terms)
        covariance = np.zeros((k, k)) if self.covariance is None else self.covariance
        covariance = _as_written(covariance, ARCSEC**2)
        if covariance.shape != (k, k):
            raise ValueError(
                f'covariance of shape {covariance.shape} for {k} terms; it must be ({k}, {k})')
        if not all_finite(covariance):
            raise ValueError('pointing model with a covariance that is not finite; fit it again')
        values = _as_written(list(self.terms.values()), ARCSEC)
        if not all_finite(values):
            bad = [name for name, v in zip(self.terms, values) if not np.isfinite(v)]
            raise ValueError(f'pointing model with {", ".join(bad)} not finite; fit it again')
        if self.joint is not None:
            size = k + sum(len(e.coefficients) for e in self.effects)
            joint = np.asarray(self.joint, float)
            # full precision: for nearly collinear columns small differences between entries matter
            joint = _as_written(0.5 * (joint + joint.T), ARCSEC**2)
            if not all_finite(joint):
                raise ValueError('pointing model with a joint covariance that is not finite; '
                                 'fit it again')
            # a model with only some effects of another has no joint covariance, see `with_effects`
            object.__setattr__(self, 'joint', joint if joint.shape == (size, size) else None)
        object.__setattr__(self, 'terms', dict(zip(self.terms, values.tolist())))
        object.__setattr__(self, 'covariance', covariance)

    def with_effects(self, keep):
        """The same model, with only the effects for which `keep(fitted)` is true."""
        kept = [keep(e) for e in self.effects]
        joint = self.joint
        if joint is not None:
            rows = np.concatenate((np.ones(len(self.terms), bool), np.repeat(
                np.array(kept, bool), [len(e.coefficients) for e in self.effects])))
            joint = joint[np.ix_(rows, rows)]
        return replace(self, effects=[e for e, own in zip(self.effects, kept) if own], joint=joint)

    def _split(self):
        """Coefficients of the rotations, and coefficients that add first-order columns."""
        if self.geometry == 'first_order':
            return {}, self.terms
        turned = {n: v for n, v in self.terms.items() if n in self.mount.names.terms}
        return turned, {n: v for n, v in self.terms.items() if n not in turned}

    def _added(self, az, el, columns):
        """On-sky offset added to the encoder angles beyond the rotations."""
        trig = Trig(az, el, self.mount)
        x, y = 0.0, 0.0
        for term in known_terms(columns, self.mount):
            of = trig.columns(term)
            x, y = x + columns[term.name] * of[0], y + columns[term.name] * of[1]
        if self.harmonics is not None:
            hx, hy = self.harmonics.offsets(np.ravel(az), np.ravel(el))
            x, y = x + hx.reshape(np.shape(az)), y + hy.reshape(np.shape(az))
        return x, y

    def _from_effects(self, az, el, az_enc, el_enc, context):
        """On-sky offset of the effects; unknown readings are predicted by the model itself."""
        shape = (2, *np.shape(az))
        az, el, az_enc, el_enc = (np.ravel(v) for v in (az, el, az_enc, el_enc))
        context = as_context(context, az, el, self.mount)
        if {'az_enc', 'el_enc', 'az_raw', 'el_raw'} & set(context.columns):
            return total(self.effects, context).reshape(shape)
        # the reading depends on the correction itself: iterate; each round divides the error by
        # period / (2 pi amplitude)
        x, y = np.zeros((2, len(context)))
        for _ in range(12 if self.follows_reading else 1):
            x, y = total(self.effects, context.at(
                az, el, az_enc=az_enc + x / np.cos(el), el_enc=el_enc + y))
        return x.reshape(shape[1:]), y.reshape(shape[1:])

    @property
    def sigmas(self):
        """Standard errors of the terms, radians, shape (k,); NaN for undetermined terms."""
        out = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        out[[name in self.undetermined for name in self.terms]] = np.nan
        return out

    @property
    def held(self):
        """Undetermined terms that are fixed at zero, tuple of str: other terms absorb them."""
        return tuple(name for name in self.undetermined if self.terms[name] == 0.0)

    @property
    def undetermined_harmonics(self):
        """Coefficients of the harmonics that the stars did not determine, tuple of str."""
        return tuple(name for name in names_of() if name not in self.terms and any(
            abs(one.get(name, 0.0)) > OPEN for one in self.directions))

    @property
    def follows_reading(self):
        """Whether an effect depends on what the encoders read."""
        return any(e.effect.driver.startswith('reading') for e in self.effects)

    def unknown(self, az, el, context=None):
        """Effects that cannot act because a driver is missing.

        Parameters
        ----------
        az, el : float or ndarray, shape (n,)
            Catalogue place, radians.
        context : Context, dict of drivers or PointingRun, optional

        Returns
        -------
        dict of str to ndarray of bool, shape (n,)
            Name of the effect -> rows in which it counts as zero. Only effects with such rows.
        """
        az, el = np.broadcast_arrays(np.atleast_1d(az), np.atleast_1d(el))
        context = as_context(context, az, el, self.mount)
        # the reading is predicted where it is not given
        context = context.at(az, el, **{f'{axis}_enc': value for axis, value in
                                        (('az', az), ('el', el))
                                        if f'{axis}_enc' not in context.columns})
        rows = {e.effect.name: e.unknown(context) for e in self.effects}
        return {name: mask for name, mask in rows.items() if mask.any()}

    def sky_to_encoder(self, az, el, context=None):
        """Encoder angles that point at a catalogue place.

        Parameters
        ----------
        az, el : float or ndarray
            Catalogue place, radians.
        context : Context, dict of drivers or PointingRun, optional
            Drivers of the effects by the names of `run.COLUMNS`, such as temperature, approach_az.
            If it has no encoder reading, the reading is predicted.

        Returns
        -------
        az_enc, el_enc : ndarray
            Radians. The azimuth is on the branch nearest to `az`. NaN where the mount cannot point
            (see `geometry.sky_to_encoder`).
        """
        az, el = np.broadcast_arrays(np.asarray(az, float), np.asarray(el, float))
        turned, columns = self._split()
        az_enc, el_enc = rotation.sky_to_encoder(az, el, turned, self.mount)
        if columns or self.harmonics is not None:
            x, y = self._added(az, el, columns)
            az_enc, el_enc = az_enc + x / np.cos(el), el_enc + y
        if self.effects:
            x, y = self._from_effects(az, el, az_enc, el_enc, context)
            az_enc, el_enc = az_enc + x / np.cos(el), el_enc + y
        return az_enc, el_enc

    def encoder_to_sky(self, az_enc, el_enc, context=None):
        """Catalogue place at which the mount points: the inverse of `sky_to_encoder`.

        Parameters
        ----------
        az_enc, el_enc : float or ndarray
            Encoder angles, radians.
        context : Context, dict of drivers or PointingRun, optional
            For the effects; see `sky_to_encoder`.

        Returns
        -------
        az, el : ndarray
            Radians; inverse to 1e-6 arcsec. NaN where the iteration does not converge: closer to
            the zenith than the size of the offsets.
        """
        az_enc, el_enc = np.broadcast_arrays(np.asarray(az_enc, float), np.asarray(el_enc, float))
        turned, columns = self._split()
        added = None
        if columns or self.harmonics is not None or self.effects:
            reading = {'az_enc': np.ravel(az_enc), 'el_enc': np.ravel(el_enc)}

            def added(az, el):
                x, y = self._added(az, el, columns)
                if self.effects:
                    flat = np.ravel(az), np.ravel(el)
                    known = as_context(context, *flat, self.mount).at(*flat, **reading)
                    dx, dy = total(self.effects, known)
                    x, y = x + dx.reshape(np.shape(az)), y + dy.reshape(np.shape(az))
                return x / np.cos(el), y
        return rotation.encoder_to_sky(az_enc, el_enc, turned, added, self.mount)

    def offsets(self, az, el, context=None):
        """Encoder - catalogue, on the sky.

        Parameters
        ----------
        az, el : float or ndarray
            Catalogue place, radians.
        context : Context, dict of drivers or PointingRun, optional
            For the effects; see `sky_to_encoder`.

        Returns
        -------
        x, y : ndarray
            delta-A cos E and delta-E, radians.
        """
        az_enc, el_enc = self.sky_to_encoder(az, el, context)
        return wrap(az_enc - az) * np.cos(el), el_enc - el

    def sigma(self, az, el, context=None):
        """Standard error of the predicted offset, from the covariance of all coefficients.

        It covers the noise of the fit, but not effects missing from the model. Where `joint` is
        not known, the coefficients of the effects count as independent.

        Parameters
        ----------
        az, el : float or ndarray
            Catalogue place, radians.
        context : Context, dict of drivers or PointingRun, optional
            For the effects; see `sky_to_encoder`.

        Returns
        -------
        sx, sy : ndarray
            On the sky, radians; NaN where the error is unknown, see `is_open`.
        """
        shape = np.broadcast_shapes(np.shape(az), np.shape(el))
        az, el = (np.broadcast_to(v, shape).ravel() for v in (az, el))
        columns = np.stack(design(tuple(self.terms), az, el, self.mount), axis=1)  # (n, 2, k)
        unknown = self.is_open(az, el)
        if self.joint is not None and self.harmonics is None:
            context = as_context(context, az, el, self.mount)
            columns = np.concatenate((columns, *(
                np.moveaxis(e.effect.columns(context), 2, 0).transpose(0, 2, 1)
                for e in self.effects)), axis=2)
            x, y = np.einsum('nak,nak->an', columns @ self.joint, columns)
            return tuple(np.where(unknown, np.nan, np.sqrt(np.maximum(v, 0.0))).reshape(shape)
                         for v in (x, y))
        variance = columns @ self.covariance @ columns.transpose(0, 2, 1)
        x, y = variance[:, 0, 0], variance[:, 1, 1]
        if self.harmonics is not None:
            hx, hy = self.harmonics.variance(az, el)
            x, y = x + hx, y + hy
        for fitted in self.effects:
            ex, ey = fitted.variance(as_context(context, az, el, self.mount))
            x, y = x + ex, y + ey
        return tuple(np.where(unknown, np.nan, np.sqrt(np.maximum(v, 0.0))).reshape(shape)
                     for v in (x, y))

    def is_open(self, az, el):
        """Whether a prediction depends on what the stars of the fit did not determine.

        Either a degenerate direction changes it, or it is on a side of the pier without any star:
        how errors change with the side is then unknown.

        Parameters
        ----------
        az, el : float or ndarray
            Catalogue place, radians.

        Returns
        -------
        ndarray of bool
        """
        az, el = np.broadcast_arrays(np.asarray(az, float), np.asarray(el, float))
        out = np.zeros(az.shape, bool)
        if self.directions:
            names = tuple(self.terms)
            columns = np.array(design(names, az.ravel(), el.ravel(), self.mount))  # (2, n, k)
            if self.harmonics is not None:
                names += names_of()
                columns = np.concatenate((columns, np.moveaxis(columns_of(
                    DEGREE, az.ravel(), el.ravel(), self.harmonics.interpretation), 0, 2)), 2)
            along = np.array([[one.get(name, 0.0) for name in names] for one in self.directions])
            out |= (np.abs(columns @ along.T) > OPEN).any(axis=(0, 2)).reshape(out.shape)
        if self.sides is not None and 0 in self.sides:
            out |= is_beyond(el) == (self.sides[1] == 0)
        return out

    def residuals(self, run, encoder='enc', zero=NO_ZERO):
        """Residuals of a run from the model, on the sky.

        Parameters
        ----------
        run : PointingRun
        encoder : {'enc', 'abs'}
            Pair of encoder columns.
        zero : PowerOnZero or Zeros
            Zero subtracted from the encoder angles.

        Returns
        -------
        x, y : ndarray, shape (n,)
            (encoder - model) in azimuth x cos E, and in elevation, radians.
        """
        az, el = run['az'], run['el']
        context = Context.from_run(run, encoder) if self.effects else None
        az_enc, el_enc = self.sky_to_encoder(az, el, context)
        zero_az, zero_el = zero.row_angles(run)
        x = wrap(run[f'az_{encoder}'] - zero_az - az_enc) * np.cos(el)
        return x, run[f'el_{encoder}'] - zero_el - el_enc

    # files and messages, see `model_document`: imported late, since it imports this module

    def to_json(self):
        """`model_document.to_json` of this model."""
        from .model_document import to_json
        return to_json(self)

    def save(self, path):
        """`model_document.save` of this model."""
        from .model_document import save
        save(self, path)

    @staticmethod
    def from_json(text):
        """`model_document.from_json`."""
        from .model_document import from_json
        return from_json(text)

    @staticmethod
    def load(path, mount=None):
        """`model_document.load`."""
        from .model_document import load
        return load(path, mount)
