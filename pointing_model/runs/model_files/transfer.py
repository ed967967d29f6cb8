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

"""Export a model to the terms of a program and import it, refitted if necessary; the loss."""

from dataclasses import dataclass, replace

import numpy as np

from msg_tools.units import ARCSEC, wrap
from pointing_model.context import Context
from pointing_model.effects.product import RESULTS, written
from pointing_model.mounts import ALTAZ, is_beyond, through_pole
from pointing_model.pointing_terms import stacked_design
from pointing_model.rms import rms

from .program import Program, Sheet, model_of, rotations, spread
from .term_columns import KEY_TERMS, TERM_KEYS, model_columns, on_sky

#: a smaller loss counts as none, arcsec
HELD = 1e-3
#: a refit adds terms of the program until the residual RMS is below this, arcsec ...
_ENOUGH = 0.01
#: ... or the best of them reduces the RMS by less than this fraction
_PAYS = 0.03
#: a column is undetermined on this sky if less than this fraction of it is orthogonal to the others
_DETERMINED = 1e-3
_STEPS = 20
_LOWEST = np.radians(20.0)


@dataclass(frozen=True)
class ExportLoss:
    """Difference of two models over a set of directions, arcsec on the sky."""

    rms: float
    largest: float
    directions: int
    unseen: int = 0

    def to_dict(self):
        """JSON-ready."""
        return {'rms_arcsec': self.rms, 'max_arcsec': self.largest,
                'directions': self.directions, 'not_reached': self.unseen}


def uniform_sky(count=600, mount=ALTAZ):
    """Directions spread evenly over the sky above 20 degrees, as a Context of axis angles.

    For a German mount each is on the side where the counterweight is down.
    """
    az, el = spread(count, _LOWEST)
    if mount.vertical:
        return Context(az, el)
    ha, dec = mount.axes_of(az, el)
    return Context(*through_pole(ha, dec, (ha < 0.0) & (mount.two_sided)), mount=mount)


def difference(one, other, el):
    """On-sky difference of two pairs of encoder angles, shape (2, n)."""
    return np.stack([wrap(one[0] - other[0]) * np.cos(el), wrap(one[1] - other[1])])


def loss_of(target, encoder, values, sky):
    """Difference of a program's model from given encoder angles.

    Parameters
    ----------
    target : ndarray, shape (2, n)
        Encoder angles, radians.
    encoder : callable
        See `Program.encoder`.
    values : dict
    sky : Context

    Returns
    -------
    ExportLoss
    """
    left = difference(target, encoder(values, sky.az, sky.el), sky.el) / ARCSEC
    good = np.isfinite(left).all(axis=0)
    size = np.hypot(*left[:, good])
    if not good.any():
        return ExportLoss(float('nan'), float('nan'), 0, len(sky))
    return ExportLoss(rms(size), float(size.max()), int(good.sum()),
                int((~good).sum()))


@dataclass
class Exported:
    """A model in a program's terms.

    Attributes
    ----------
    program : Program
    text : str
        Of the file.
    terms : dict of str to float
        As in the file, radians or plain numbers: see `listed`.
    direct, loss : ExportLoss
        With the terms converted by name only, and with the terms of the file.
    elsewhere : ExportLoss or None
        Like `loss` on a uniform sky, for the part that depends on direction only; None if `loss` is
        on a uniform sky already.
    refitted : bool
        Whether the values are from a refit.
    added : list of str
        Terms of the program that the model lacks, added by the refit to absorb other parts.
    left : list of str
        Parts of the model that the program has no term for. Effects of other drivers than the
        direction are zero in the file; the loss includes them with the run's values.
    notes : list of str
    sky : str
        Description of the directions that the losses are for.
    """

    program: Program
    text: str
    terms: dict
    direct: ExportLoss
    loss: ExportLoss
    elsewhere: ExportLoss | None
    refitted: bool
    added: list
    left: list
    notes: list
    sky: str

    def listed(self):
        """(name, value, unit) of each term, in arcsec; plain numbers have the unit ''."""
        return [(name, value, '') if name in self.program.plain
                else (name, value / ARCSEC, 'arcsec') for name, value in self.terms.items()]

    @property
    def held(self):
        """Whether the program agrees with the model to 0.001 arcsec."""
        return not self.left and self.loss.largest <= HELD

    def to_dict(self):
        """JSON-ready."""
        return {'program': self.program.name, 'held': self.held, 'terms': [
                    dict(zip(('name', 'value', 'unit'), row)) for row in self.listed()],
                'refitted': self.refitted, 'added': self.added, 'not_held': self.left,
                'sky': self.sky, 'by_name': self.direct.to_dict(), 'loss': self.loss.to_dict(),
                'elsewhere': self.elsewhere and self.elsewhere.to_dict(),
                'notes': self.notes}


def export(model, program, sky=None, sky_name='', facts=None, beyond=None):
    """Convert a model to the terms of a program, refitted if necessary.

    Parameters
    ----------
    model : PointingModel
    program : Program
    sky : Context, optional
        The directions of a run, with the drivers of the model's effects; by default
        `uniform_sky`.
    sky_name : str
        Description of `sky`, for people.
    facts : dict, optional
        Attributes of `program.Sheet` for the file.
    beyond : bool, optional
        Restricts the model to one pier side: through the pole or not.

    Returns
    -------
    Exported

    Raises
    ------
    ValueError
        The program does not support the model's mount; its terms are reversed through the pole but
        those of the model act on the sky; or the model cannot point to any of the directions.
    """
    program, given = program_for(program, model.mount), sky is not None
    if model.mount.on_sky and not program.one_sided:
        raise ValueError(f'{program.title} reverses the terms of a German mount through the '
                         'pole. Those of this model act on the sky, alike on both sides of the '
                         'pier. Use --to model or --to table')
    whole = uniform_sky(mount=model.mount)
    if not given:
        sky, sky_name = whole, 'a uniform sky above 20 degrees'
    if beyond is not None:
        sky, whole = (one.select(is_beyond(one.el) == beyond) for one in (sky, whole))
        sky_name += f', {"west" if beyond else "east"} of the pier'
        facts = {**(facts or {}), 'beyond': beyond}
    target = np.stack(model.sky_to_encoder(sky.az, sky.el, sky))
    good = np.isfinite(target).all(axis=0)
    sky, target = sky.select(good), target[:, good]
    if not len(sky):
        raise ValueError('the model reaches none of the directions of this sky')
    # without effects of other drivers than the direction, such as approach or temperature
    still = model.with_effects(lambda fitted: not fitted.effect.requires)
    aim = np.stack(still.sky_to_encoder(sky.az, sky.el))
    values, sigma, left = model_columns(model)
    values = {key: value for key, value in values.items() if value or (
              key in KEY_TERMS or not model.mount.vertical) and program.own(key) is not None}
    lacking = [key for key in values if program.own(key) is None]
    left += [_column_name(key) for key in lacking]
    taken = {key: value for key, value in values.items() if key not in lacking}
    direct, still_direct = (loss_of(to, program.encoder, taken, sky) for to in (target, aim))
    refitted, added = False, []
    # rotations in another order than ours always need a refit
    if program.geometry is None or not still_direct.largest <= HELD:
        refitted = True
        taken, added = _refit(program, aim, taken, sky,
                              bool(lacking) or len(model_columns(still)[2]))
    if program.whole:
        taken = _to_whole(program, taken, sky)
    terms, errors = {}, {}
    for key, value in taken.items():
        for name, share in program.own(key):
            terms[name] = terms.get(name, 0.0) + share * value
            if key in sigma and not refitted:
                errors[name] = abs(share) * sigma[key]
    if refitted:
        errors = _errors(program, still, list(taken), sky)
    nobody = {name for key in taken if key in values and key not in sigma
              for name, _ in program.own(key)}
    errors = {name: error for name, error in errors.items()
              if not (model.undetermined and name in nobody)}
    text = program.write(Sheet(terms, errors, **{'caption': 'telescope_mount', **(facts or {})}))
    # compare what the file holds, with its rounding
    found = program.read('the exported file', text)
    read = _column_values(program, found.terms)
    loss, elsewhere = loss_of(target, program.encoder, read, sky), None
    if given:
        elsewhere = loss_of(np.stack(still.sky_to_encoder(whole.az, whole.el)), program.encoder,
                            read, whole)
    notes = list(found.notes)
    if found.sigma and not any(errors.values()):
        notes.append('the sigmas in the file are 0: ' + (
            'the model has no standard errors' if model.harmonics is None
            else 'those of a model with harmonics are not carried over'))
    for who, encoder in program.otherwise:
        other = loss_of(target, encoder, read, sky)
        if other.largest > HELD:
            notes.append(f'{who}: off by {other.rms:.3f} arcsec RMS, at most {other.largest:.3f}')
    return Exported(program, text, found.terms, direct, loss, elsewhere, refitted,
                    [n for key in added for n, _ in program.own(key)], left, notes, sky_name)


def program_for(program, mount):
    """The program with the terms of a mount; ValueError if it does not support the mount."""
    if mount.vertical:
        return program
    if program.for_mount is None:
        raise ValueError(f'models of {program.title} are read and written for alt-azimuth '
                         f'mounts only; this mount is {mount.kind}')
    return program.for_mount(mount)


def _column_name(key):
    if key[0] not in RESULTS:
        return key[0]
    return KEY_TERMS.get(key) or f'{written(key[1])} {RESULTS[key[0]][1]}'


def _column_values(program, terms):
    out = {}
    for name, value in terms.items():
        for key, share in program.column(name):
            out[key] = out.get(key, 0.0) + share * value
    return out


def _refit(program, target, start, sky, more):
    """Fit the program's columns to encoder angles; the values, and the columns that were added.

    With `more`, if parts of the model have no column in the program, its other columns are added by
    forward selection (`_PAYS`). This is not done to absorb second-order residuals of rotations.
    """
    index = [TERM_KEYS[n] for n in ('IA', 'IE')] if program.mount.vertical else [
        (n, ()) for n in program.mount.names.index]
    keys = [*start, *(key for key in index if key not in start)]
    keys = [key for key in keys if program.own(key) is not None]
    begun = list(keys)
    values = _solved(program, target, {key: start.get(key, 0.0) for key in keys}, sky)
    pool = {key: np.ravel(on_sky(key, sky.az, sky.el, program.mount)) for key in program.candidates
            if more and key not in keys}
    while pool:
        left = np.ravel(difference(target, program.encoder(values, sky.az, sky.el), sky.el))
        rms = np.sqrt(2.0 * np.mean(left**2)) / ARCSEC
        if not rms > _ENOUGH:
            break
        base = np.linalg.qr(np.stack([np.ravel(on_sky(k, sky.az, sky.el, program.mount))
                                      for k in keys], axis=1))[0]
        left = left - base @ (base.T @ left)
        best, gain = None, 0.0
        for key, column in pool.items():
            beside = column - base @ (base.T @ column)
            size = np.linalg.norm(beside)
            if size > _DETERMINED * np.linalg.norm(column):
                took = (beside @ left / size) ** 2
                if took > gain:
                    best, gain = key, took
        whole = left @ left
        if best is None or np.sqrt(max(whole - gain, 0.0)) > (1.0 - _PAYS) * np.sqrt(whole):
            break
        del pool[best]
        keys.append(best)
        values = _solved(program, target, {**values, best: 0.0}, sky)
    return values, [key for key in keys if key not in begun]


def _solved(program, target, start, sky):
    """Gauss-Newton fit with first-order columns."""
    values = dict(start)
    keys = list(values)
    if not keys:
        raise ValueError(f'that program has no terms for {program.mount.names.words}; '
                         '--to table works for any mount')
    columns = np.stack([np.ravel(on_sky(key, sky.az, sky.el, program.mount)) for key in keys],
                       axis=1)
    size = np.linalg.norm(columns, axis=0)
    for _ in range(_STEPS):
        left = np.ravel(difference(target, program.encoder(values, sky.az, sky.el), sky.el))
        good = np.isfinite(left)
        step = np.linalg.lstsq((columns / size)[good], left[good], rcond=1e-6)[0] / size
        values = {key: value + d for (key, value), d in zip(values.items(), step)}
        if np.abs(step * size).max() < 1e-7 * ARCSEC * np.sqrt(len(left)):
            break
    return values


def _errors(program, model, keys, sky):
    """Standard errors of a refit by name, propagated from the covariance of the model.

    The offsets by the model's coefficients on this sky are fitted with the program's columns, like
    the model itself. For the covariance see `PointingModel.sigma`.
    """
    if model.harmonics is not None or not keys:
        return {}
    n, mount = len(sky), program.mount
    moved = [stacked_design(tuple(model.terms), sky.az, sky.el, mount)] if model.terms else []
    moved += [fitted.effect.columns(sky).reshape(-1, 2 * n) for fitted in model.effects]
    if not moved:
        return {}
    covariance = model.joint
    if covariance is None:
        k, sigma = len(model.terms), [e.sigma for e in model.effects]
        covariance = np.diag(np.concatenate((np.zeros(k), *sigma))**2)
        covariance[:k, :k] = model.covariance
    values, vectors = np.linalg.eigh(covariance)
    moved = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T @ np.vstack(moved)
    columns = np.stack([np.ravel(on_sky(key, sky.az, sky.el, mount)) for key in keys], axis=1)
    size = np.linalg.norm(columns, axis=0)
    each = np.linalg.lstsq(columns / size, moved.T, rcond=1e-6)[0] / size[:, None]
    out = {}
    for key, one in zip(keys, each):
        for name, share in program.own(key):
            out[name] = out.get(name, 0.0) + share * one
    return {name: float(np.linalg.norm(one)) for name, one in out.items()}


def _to_whole(program, values, sky):
    """Round the values one by one, refitting the rest after each to compensate."""
    free = dict(values)
    columns = {key: np.ravel(on_sky(key, sky.az, sky.el, program.mount)) for key in free}
    out = {}
    for key in sorted(free, key=lambda k: -np.linalg.norm(columns[k])):
        value = free.pop(key)
        out[key] = np.rint(value / program.whole) * program.whole
        if free:
            rest = np.stack([columns[k] for k in free], axis=1)
            moved = np.linalg.lstsq(rest, (value - out[key]) * columns[key], rcond=1e-6)[0]
            free = {k: v + d for (k, v), d in zip(free.items(), moved)}
    return out


def imported(program, found, source=''):
    """Our `PointingModel` of a model file.

    Parameters
    ----------
    program : Program
    found : ModelFile
    source : str

    Returns
    -------
    model : PointingModel
    loss : ExportLoss or None
        Difference of our model from the program's, if ours had to be fitted to it.
    """
    values = _column_values(program, found.terms)
    sigma = {}
    for name, error in found.sigma.items():
        for key, share in program.column(name):
            sigma[key] = float(np.hypot(sigma.get(key, 0.0), share * error))
    provenance = {'source': str(source), 'program': program.name}
    if program.geometry:
        return model_of(values, sigma, program.geometry, provenance, program.mount), None
    # the program's geometry is neither of ours: fit our model to it
    sky = uniform_sky(mount=program.mount)
    target = np.stack(program.encoder(values, sky.az, sky.el))
    ours = replace(program, geometry='rotation', encoder=lambda values, az, el: rotations(
        values, az, el, program.mount))
    values = _solved(ours, target, values, sky)
    return model_of(values, sigma, 'rotation', provenance, program.mount), loss_of(
        target, ours.encoder, values, sky)
