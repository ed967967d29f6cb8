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

"""Checks of a plate-solved run: false solutions, copies, coordinate frame, sigma."""

from dataclasses import dataclass

import numpy as np

from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.mounts import is_beyond, through_pole
from pointing_model.rms import rms, sigma_of
from pointing_model.runs.plate_solves.frames import B1950, ICRS, MEAN_OF_DATE, OF_DATE, to_date
from pointing_model.runs.run import PointingRun
from pointing_model.runs.run_reader import EQUINOXES
from pointing_model.sky.places import sidereal_time

from .finding import Finding
from .term_fit import fit_terms

#: fewest rows for any test: seven terms and a scatter need more
FEW = 8
#: a row is a false solution beyond this many times the noise, and at least this far off
_FALSE, _FALSE_LEAST = 20.0, 60.0 * ARCSEC
_MOST = 1.0 / 3.0  # largest part of false rows: with more it is unknown which are false
_TRIES, _SCORED = 300, 500  # pairs of rows that each give a trial rotation; rows that test it
_SHARE = 0.6  # part of the rows that must agree with the rotation
_NEAR, _NEAR_LEAST = 10.0, 0.2 * DEG  # limit for inliers: times the agreement of these; at least
_LOST = 3.0 * DEG  # worst agreement of these rows: beyond it no rotation fits
#: ratio of noise, and ln of the likelihood ratio, by which another frame must fit better to refuse
#: the declared one; ln by which an assumed frame must be better if none was declared
_BETTER, _LIKELIER, _DECISIVE = 1.25, 15.0, 10.0
_FITS = 600.0  # arcsec, largest RMS of a frame that fits
_LEAST_NOISE = 1e-4 * ARCSEC
_TILT = 1.0 * DEG  # implausible tilt of an azimuth axis
_HOURS = 24.0 * DEG
_ROWS = 3000  # most rows fitted; more are thinned evenly
_DIGITS = 1e4  # per degree: if all coordinates are multiples, equal ones may be due to rounding


def check_solves(run):
    """Exclude false solutions, and check the coordinate frame against the declared one.

    Parameters
    ----------
    run : PointingRun
        With ``meta['solved']`` (`pointing_model.runs.plate_solves`); without it the run is
        returned unchanged.

    Returns
    -------
    PointingRun
        False and copied solutions are in ``meta['excluded']``; their reasons, and additions to
        ``meta['notes']``, are Findings. If the solutions have their own sigma, `sigma_x` and
        `sigma_y` combine it with the additional scatter of the rows. ``meta['solves_checked']`` is
        set.

    Raises
    ------
    ValueError
        The places fit another frame far better than the declared or assumed one, or no frame was
        declared and the rows cannot determine it.
    """
    solved = run.meta.get('solved')
    if solved is None:
        return run
    solved = solved.at(run.lines)
    notes = list(run.meta.get('notes', ()))
    reasons = _false_rows(run, solved, notes) if len(run) >= FEW else {}
    keep = np.array([i not in reasons for i in range(len(run))], bool)
    excluded = sorted(
        [*run.meta.get('excluded', ()), *({'row': int(run.lines[i]), 'reason': found}
                                          for i, found in reasons.items())], key=lambda e: e['row'])
    solved = solved.at(run.lines[keep])
    run = run.part(keep, notes=notes, excluded=excluded, solves_checked=True)
    _check_frame(run, solved)
    if len(run) >= FEW:
        _note_tilt(run)
        run = _with_noise(run)
    return run


# ----------------------------------------------------------------------------------- false rows

def _false_rows(run, solved, notes):
    """Findings on false rows, by their index in the run."""
    left, noise = _from_the_others(run)
    if left is None:
        return {}
    far = left > max(_FALSE * noise, _FALSE_LEAST)
    copies = _copies(run, solved, left, far)
    if len(set(np.flatnonzero(far)) | set(copies)) > _MOST * len(run):
        notes.append(Finding('many far places', int(far.sum()), unit='',
                             evidence={'rows': len(run)}))
        return {}
    return {**{int(i): Finding('far place', left[i] / ARCSEC) for i in np.flatnonzero(far)},
            **copies}


def _copies(run, solved, left, far):
    """Rows with the same solution as another row, to the last digit.

    A star centred again also has the same place; then a copy must be far from where the encoders
    point.
    """
    first, out = {}, {}
    digits = np.degrees(solved.ra) * _DIGITS
    unlike = solved.from_images and bool(np.any(np.abs(digits - np.rint(digits)) > 1e-3))
    for i, place in enumerate(zip(solved.ra.tolist(), solved.dec.tolist())):
        first.setdefault(place, []).append(i)
    for rows in first.values():
        if len(rows) == 1:
            continue
        rows = sorted(rows, key=lambda i: left[i])
        for i in rows[1:]:
            if far[i] or unlike:
                out[i] = Finding('copied solution', left[i] / ARCSEC,
                                 evidence={'of': run.lines[rows[0]]})
    return out


def _from_the_others(run):
    """Distance of each row from a fit to the majority of the rows (radians), and their noise."""
    sound = _rotation_inliers(run)
    if sound is None or sound.sum() < FEW:
        return None, None
    bare = _bare(run)
    try:
        model = fit_terms(_some(bare.select(sound))).model
    except ValueError:
        return None, None
    x, y = bare.offsets()
    px, py = model.offsets(bare['az'], bare['el'])
    dx, dy = _wrapped(x - px, bare['el']), wrap(y - py)
    noise = np.hypot(sigma_of(dx[sound]), sigma_of(dy[sound]))
    left = np.hypot(dx, dy)
    return np.where(np.isfinite(left), left, np.pi), float(noise)


def _bare(run, **columns):
    """A run of places and readings alone, some replaced by `columns`; with the same mount."""
    names = ('az', 'el', 'az_enc', 'el_enc')
    return PointingRun({**{name: run[name] for name in names}, **columns}, {'mount': run.mount})


def _some(run):
    """At most `_ROWS` rows, evenly thinned."""
    if len(run) <= _ROWS:
        return run
    return run.part(np.linspace(0, len(run) - 1, _ROWS).astype(int))


def _wrapped(x, el):
    # beyond the pole the cosine is negative
    reach = np.where(np.abs(np.cos(el)) > 1e-6, np.cos(el), 1e-6)
    return wrap(x / reach) * reach


def _rotation_inliers(run):
    """Inliers of the best rotation from places to readings, or None if none fits most rows.

    Trial rotations come from random pairs of rows (RANSAC): a false solution spoils only its own
    pairs.
    """
    az, el = run['az'], run['el']
    away = run['az_enc'] - az
    zero = np.angle(np.exp(1j * away).sum())
    zero += np.median(wrap(away - zero))
    lift = np.median(run['el_enc'] - el)
    place = _vectors(az, el)
    rng = np.random.default_rng(0)
    pairs = rng.integers(0, len(run), (_TRIES, 2))
    rows = rng.permutation(len(run))[:_SCORED]
    best, least = None, _LOST
    # the zero of the elevation may be large, but its median is wrong for a strongly rotated mount
    for zero_el in (lift, 0.0):
        reading = _vectors(run['az_enc'] - zero, run['el_enc'] - zero_el)
        turns = np.concatenate((np.eye(3)[None], _rotations(place[pairs], reading[pairs])))
        scores = np.quantile(_separations(turns, place[rows], reading[rows]), _SHARE, axis=-1)
        first = int(np.argmin(scores))
        if scores[first] < least:
            best, least = _separations(turns[first], place, reading), scores[first]
    return None if best is None else best < max(_NEAR * least, _NEAR_LEAST)


def _vectors(az, el):
    return np.stack((np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)), axis=-1)


def _rotations(before, after):
    """Rotations of pairs of directions, shape (t, 2, 3), to others; without pairs too close."""
    frames, separate = [], np.ones(len(before), bool)
    for first, second in ((pair[:, 0], pair[:, 1]) for pair in (before, after)):
        normal = np.cross(first, second)
        length = np.linalg.norm(normal, axis=-1, keepdims=True)
        separate &= length[:, 0] >= 0.1
        normal = normal / np.where(length > 0.0, length, 1.0)
        frames.append(np.stack((first, normal, np.cross(first, normal)), axis=-1))
    return (frames[1] @ frames[0].transpose(0, 2, 1))[separate]


def _separations(turn, place, reading):
    """Angles between places turned by rotations (..., 3, 3) and readings, shape (..., n)."""
    off = place @ np.swapaxes(turn, -1, -2) - reading
    return 2.0 * np.arcsin(np.clip(0.5 * np.linalg.norm(off, axis=-1), 0.0, 1.0))


# ---------------------------------------------------------------------------------------- frame

@dataclass
class _FrameFit:
    what: str
    misfit: float
    rms_arcsec: float
    of_readings: bool = False


def _check_frame(run, solved):
    """Raise ValueError if another frame fits far better than the declared or assumed one."""
    frames = [solved.frame, *(f for f in (ICRS, MEAN_OF_DATE, OF_DATE, B1950)
                              if f != solved.frame)]
    where = run.meta.get('source', 'the run')
    if len(run) < FEW:
        if not solved.declared:
            raise _undeclared(run, f'{len(run)} rows cannot determine it')
        return
    run = _some(run)
    solved = solved.at(run.lines)
    taken, *others = [*(_fit_of(run, solved, frame) for frame in frames),
                      _fit_of(run, solved, solved.frame, hours=True)]
    others = [fit for fit in others if fit is not None]
    lost = taken is None
    if lost:
        taken = _FrameFit(solved.frame.text, 0.0, 1.0 / ARCSEC)
    others = sorted([*others, *_fits_of_readings(run)], key=lambda fit: fit.misfit)
    if not others:
        return
    best = others[0]
    gain = taken.misfit - best.misfit
    if np.exp(gain) > _BETTER and 2 * len(run) * gain > _LIKELIER and best.rms_arcsec < _FITS:
        _refuse_others(run, best)
        left = 'do not fit' if lost else f'leave {taken.rms_arcsec:.1f} arcsec'
        option = run.meta.get('equinox_given')
        near = [fit for fit in others if fit.misfit < best.misfit + np.log(_BETTER)]
        near.sort(key=lambda fit: not fit.of_readings)
        raise ValueError(
            f'{where}: ' + (f'--equinox {option} says' if option else 'the file says'
                            if solved.declared else 'no frame is declared; taken are')
            + f' {taken.what}, where the seven terms {left}; '
            + ', '.join(f'as {fit.what} the {"readings" if fit.of_readings else "places"} leave '
                        f'{fit.rms_arcsec:.1f} arcsec' for fit in near)
            + f'. Nothing was concluded; {_advice(run, near)} if so it is')
    if not solved.declared:
        if -2 * len(run) * gain < _DECISIVE:
            _refuse_others(run, best)
            raise _undeclared(run, f'the data cannot determine it: {taken.what} leaves '
                              f'{taken.rms_arcsec:.1f} arcsec, {best.what} {best.rms_arcsec:.1f}')
        run.meta['notes'].append(Finding(
            'frame taken', causes=(taken.what, best.what), before=taken.rms_arcsec,
            after=best.rms_arcsec))


def _refuse_others(run, best):
    """Raise MistakenColumns if another clock, site or column fits better than another frame."""
    from .diagnosis.mistaken_columns import MistakenColumns, check_columns
    try:
        check_columns(run)
    except MistakenColumns as error:
        if error.readings and error.readings[0]['rms_arcsec'] < best.rms_arcsec:
            raise


def _advice(run, fits):
    options = {frame.text: name for name, frame in EQUINOXES.items()}
    return ', or '.join(dict.fromkeys(
        'give degrees' if fit.what == 'hours' else
        f'declare {_declaration(run, fit.what, "readings")}' if fit.of_readings else
        f'give --equinox {options[fit.what]}'
        if run.meta.get('equinox_given') and fit.what in options else
        f'declare {_declaration(run, fit.what)}' for fit in fits))


def _declaration(run, frame, key='frame'):
    """The line of a file that declares its frame, or that of the readings."""
    return f'"{key}: {frame}"' if run.meta.get('format') == 'images' else f'"# {key}: {frame}"'


def _undeclared(run, why):
    where = 'in the YAML' if run.meta.get('format') == 'images' else 'above the header row'
    return ValueError(
        f'{run.meta.get("source", "the run")}: no frame of ra_deg, dec_deg is declared, and {why}; '
        f'write {_declaration(run, "ICRS")} (or J2000, of date, ...) {where}')


def _fit_of(run, solved, frame, hours=False):
    """Fit of the seven terms if the places were of `frame`, or right ascension were in hours."""
    ra = None
    if hours:
        if solved.ra.min() < 0.0 or solved.ra.max() > _HOURS:
            return None
        ra = 15.0 * solved.ra
    try:
        az, el = solved.observed(frame, ra)
        az, el = run.mount.axes_of(az, el, is_beyond(run['el']))
    except ValueError:
        return None
    return _fitted(_bare(run, az=az, el=el), 'hours' if hours else frame.text)


def _fits_of_readings(run):
    """Fits of the seven terms if the mount's own coordinates were of another frame."""
    solved = run.meta.get('solved_readings')
    if solved is None:
        return []
    solved, out = solved.at(run.lines), []
    lst = sidereal_time(solved.time, solved.site)
    for frame in (ICRS, MEAN_OF_DATE, OF_DATE):
        if frame == solved.frame:
            continue
        ra, dec = to_date(solved.ra, solved.dec, frame, solved.time)
        first, second = through_pole(lst - ra, dec, is_beyond(dec) != is_beyond(run['el_enc']))
        away = [wrap(angle - run[name]) for angle, name in ((first, 'az_enc'), (second, 'el_enc'))]
        out.append(_fitted(_bare(run, az_enc=run['az_enc'] + away[0],
                                 el_enc=run['el_enc'] + away[1]),
                           'J2000' if frame == ICRS else frame.text, of_readings=True))
    return [fit for fit in out if fit is not None]


def _fitted(bare, what, **how):
    try:
        # in another frame a place near the horizon may be below it, where refraction is undefined
        fitted = fit_terms(bare)
    except ValueError:
        return None
    fitting = np.isfinite(fitted.residual_x) & (fitted.weights > 0.0)
    if 2 * fitting.sum() <= len(fitted.names):  # any rows would fit exactly
        return None
    noise = [max(float(sigma_of(v[np.isfinite(v)])), _LEAST_NOISE)
             for v in (fitted.residual_x, fitted.residual_y)]
    return _FrameFit(what, 0.5 * float(np.log(noise[0] * noise[1])),
                     float(np.hypot(*noise)) / ARCSEC, **how)


def _note_tilt(run):
    """Add a note if the first axis has an implausible tilt: wrong clock, longitude or frame."""
    try:
        terms = fit_terms(_some(run)).model.terms
    except ValueError:
        return
    names = run.mount.names
    lean = {own: terms[own] for own, (same, _) in names.terms.items() if same in ('AN', 'AW')}
    tilt = np.hypot(*lean.values())
    if tilt > _TILT:
        run.meta['notes'].append(Finding('leaning first axis', tilt / DEG, unit='deg', evidence={
            'axis': names.axes[0], 'terms_deg': {name: value / DEG for name, value in lean.items()},
        }))


# ---------------------------------------------------------------------------------------- sigma

def _with_noise(run):
    """Add to `sigma_x`, `sigma_y` the scatter that the solver's own sigma does not include.

    A solver knows the noise of its star images, not that of seeing and mount: weighted by its sigma
    alone, a few sharp images would dominate the fit. So each axis gets an additional variance, by
    maximum likelihood from the residuals of the seven terms.
    """
    if not run.meta.get('solver_sigma') or 'sigma_x' not in run or 'sigma_y' not in run:
        return run
    some = _some(run)
    given, bare = some['sigma_x'], _bare(some)
    for _ in range(2):
        try:
            fitted = fit_terms(bare)
        except ValueError:
            return run
        used = fitted.weights > 0.0
        inflate = np.sqrt(2.0 * used.sum() / max(2.0 * used.sum() - len(fitted.coefficients), 1.0))
        extra = [_extra(inflate * r[used], given[used])
                 for r in (fitted.residual_x, fitted.residual_y)]
        bare = _bare(some, **{name: np.hypot(given, more)
                              for name, more in zip(('sigma_x', 'sigma_y'), extra)})
    given = run['sigma_x']
    columns = {name: np.hypot(given, more) for name, more in zip(('sigma_x', 'sigma_y'), extra)}
    out = PointingRun({**run.columns, **columns}, run.meta)
    out.meta['notes'] = [*run.meta['notes'], Finding('sigma of the solver', evidence={
        'given_arcsec': (given.min() / ARCSEC, given.max() / ARCSEC),
        'scatter_arcsec': [more / ARCSEC for more in extra]})]
    return out


def _extra(left, sigma):
    """Standard deviation of `left` beyond `sigma`, by maximum likelihood."""
    from scipy.optimize import minimize_scalar

    def cost(extra):
        variance = np.square(sigma) + extra * extra
        return float(np.sum(np.log(variance) + np.square(left) / variance))
    most = 3.0 * rms(left) + _LEAST_NOISE
    found = minimize_scalar(cost, bounds=(0.0, most), method='bounded',
                            options={'xatol': 1e-3 * most})
    return float(found.x) if found.fun < cost(0.0) else 0.0
