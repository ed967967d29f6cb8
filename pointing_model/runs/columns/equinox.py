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

"""Catalogue places of unknown equinox: J2000 or of date, if the data decide.

Omitted precession is a rotation about an axis that turns with the sky: a mount sees a polar axis
error that changes with sidereal time. Over an hour or two this is a slow function of time, like
drifting zeros, and a function of direction if the sky is covered in some order. So both equinoxes
are tested with such effects in the model, as two groups of random effects with fitted variances:
the other terms of the mount with differences between the pier sides, and zeros that drift as a
random walk. The likelihoods compared have the terms and these groups integrated out, so that what
they can explain decides nothing (restricted likelihood: Patterson and Thompson, Biometrika 58,
545, 1971).
"""

import numpy as np

from msg_tools.units import ARCSEC, wrap
from pointing_model import geometry
from pointing_model.mounts import is_beyond, through_pole
from pointing_model.pointing_terms import stacked_design, terms_of

from .pier_side import read_beyond

#: the equinoxes tested; the first is taken if the data do not decide
J2000, OF_DATE = 'J2000', 'of date'
#: least difference of the log-likelihoods that decides
DECISIVE = 10.0
#: to refuse a given equinox: difference of the log-likelihoods, least ratio of the residuals of the
#: terms alone (given to other), and largest residual of the other, arcsec
_REFUSED, _TIMES, _FITS = 30.0, 1.25, 600.0
_ROWS = 1000  # at most this many rows are tested, evenly spaced
_MODES = 6  # modes of the random walk of each axis
_LEAST_NOISE = 0.5  # arcsec
_OUTLIER = 6.0  # times the noise: larger residuals get no weight
_ROUNDS = 4
_SIZES = (-8.0, 5.0)  # limits of the log of a group's standard deviation, in units of the noise
_FAR = 0.1  # rad: a term this large is undetermined, and the model is not made exact with it


def which_fits(table, rows, icrs, apparent, mount):
    """Azimuth and elevation of the rows, with the equinox that fits better.

    Parameters
    ----------
    table : Table
        With the readings, radians. It gets a note on the result, and the result itself as
        ``meta['equinox_taken']``, see `comparison`.
    rows : ndarray of bool, shape (n,)
        Rows of the table that the places belong to.
    icrs : tuple of ndarray
        Observed azimuth and elevation with the places taken as ICRS.
    apparent : tuple
        Right ascension, declination, time, site and weather of the places, which may be apparent
        places of date.
    mount : Mount

    Returns
    -------
    az, el : ndarray
    """
    places = {J2000: icrs, OF_DATE: _observed(OF_DATE, *apparent)}
    found = _compared(table, rows, places, apparent, mount)
    table.meta['equinox_taken'] = found
    table.meta['notes'].append(sentence(found))
    return places[found['taken']]


def refuse_contradicted(path, table, rows, place, given, mount):
    """Refuse the given equinox if the other fits far better; add a note if it fits better.

    Parameters
    ----------
    path : Path
    table, rows, mount
        See `which_fits`.
    place : tuple of ndarray
        Observed azimuth and elevation with the given equinox.
    given : tuple
        See `apparent` of `which_fits`.

    Raises
    ------
    ValueError
        The other fits far better.
    """
    option = table.meta['equinox_given']
    taken, other, instead = (J2000, OF_DATE, 'date') if option == 'j2000' else (
        OF_DATE, J2000, 'j2000')
    found = _compared(table, rows, {taken: place, other: _observed(other, *given)}, given, mount)
    if found['likelier'] != other or not found['told']:
        return
    left = found['left_arcsec']
    text = (f'--equinox {option} contradicts the rows: median residual of the terms '
            f'{left[taken]:.1f} arcsec if {taken}, {left[other]:.1f} if {other} (log-likelihood '
            f'ratio {found["log_likelihood"]:.0f})')
    if found['log_likelihood'] > _REFUSED and (
            _TIMES * left[other] < min(left[taken], _TIMES * _FITS)):
        raise ValueError(f'{path}: {text}. Give --equinox {instead}, or '
                         'leave it out')
    table.meta['notes'].insert(0, text)


def _observed(equinox, ra, dec, time, *air):
    """Observed azimuth and elevation of places of an equinox."""
    from pointing_model.runs.plate_solves import frames
    from pointing_model.sky.places import icrs_to_observed
    if equinox == OF_DATE:
        ra, dec = frames.to_icrs(ra, dec, frames.OF_DATE, time)
    return icrs_to_observed(ra, dec, time, *air)


def _compared(table, rows, places, apparent, mount):
    reading = np.array([table.columns[name][rows] for name in ('az_enc', 'el_enc')])
    ra, _, time, *_ = apparent
    return comparison(places, reading, np.broadcast_to(time, np.shape(ra)), mount)


def comparison(places, reading, time, mount):
    """Compare the fits with two equinoxes.

    Parameters
    ----------
    places : dict of {str: (ndarray, ndarray)}
        Equinox -> azimuth and elevation, radians, shape (n,); the default first.
    reading : ndarray, shape (2, n)
        Readings of the axes, radians.
    time : ndarray, shape (n,)
        Seconds.
    mount : Mount

    Returns
    -------
    dict
        ``taken`` and ``other``: the equinoxes. ``told``: whether the data decide. ``likelier``: the
        equinox of higher likelihood, and ``log_likelihood``: the difference. ``left_arcsec``:
        residual of a fit of the physical terms alone for each equinox (robust, radial).
        ``polar_axis_arcsec``: polar axis terms of that fit for each equinox (omitted if there are
        none or the data cannot determine them).
    """
    default, other = places
    places = {name: np.array(place) for name, place in places.items()}
    good = np.isfinite(time) & np.isfinite(reading).all(axis=0)
    for place in places.values():
        good &= np.isfinite(place).all(axis=0)
    numbers = np.flatnonzero(good)
    numbers = numbers[np.linspace(0, len(numbers) - 1, min(len(numbers), _ROWS)).astype(int)] \
        if len(numbers) else numbers
    found = {'taken': default, 'other': other, 'told': False, 'likelier': default,
            'log_likelihood': 0.0, 'left_arcsec': {}, 'polar_axis_arcsec': {}}
    names = mount.names.physical
    if len(numbers) <= len(names):
        return found
    fits = {name: _EquinoxFit(place[:, numbers], reading[:, numbers], time[numbers], mount)
            for name, place in places.items()}
    weights = np.ones(len(numbers))
    for _ in range(_ROUNDS):
        for fit in fits.values():
            fit.fit(weights)
        # a row that is an outlier with one equinox only may be what separates them
        weights = np.max([fit.weights() for fit in fits.values()], axis=0)
    gain = float(fits[other].misfit - fits[default].misfit)
    found['likelier'], found['log_likelihood'] = (default if gain >= 0.0 else other), abs(gain)
    found['told'] = abs(gain) >= DECISIVE
    if found['told'] and gain < 0.0:
        found['taken'], found['other'] = other, default
    for name, fit in fits.items():
        alone, left = fit.terms_alone()
        found['left_arcsec'][name] = left
        polar = {term: alone[term] / ARCSEC for term in names
                 if mount.names.terms[term][0] in ('AN', 'AW')}
        if max(map(abs, alone.values())) < _FAR:
            found['polar_axis_arcsec'][name] = polar
    return found


def sentence(found):
    """The result in words.

    Parameters
    ----------
    found : dict
        See `comparison`.

    Returns
    -------
    str
    """
    text = 'no equinox in the file: '
    left = ', '.join(f'{v:.1f} arcsec if {name}' for name, v in found['left_arcsec'].items())
    left = f'median residual of the terms {left}' if left else 'the rows are too few'
    by = f'log-likelihood favours {found["likelier"]} by {found["log_likelihood"]:.1f}'
    if found['told']:
        return f'{text}taken as {found["taken"]}. Reason: {by}; {left}'
    out = f'{text}taken as {found["taken"]}, a guess; the data do not decide: {left}'
    if found['left_arcsec']:
        out += f'; {by} ({DECISIVE:g} would decide)'
    return f'{out}{_moved(found)}. Set it: --equinox j2000 or date'


def _moved(found):
    """How the other equinox would change the polar axis terms, in words; '' if unknown."""
    polar = found['polar_axis_arcsec']
    if set(polar) != {found['taken'], found['other']}:
        return ''
    taken, other = polar[found['taken']], polar[found['other']]
    return f'. {found["other"].capitalize()} would change ' + ', '.join(
        f'{name} by {(other[name] - value) / 60.0:+.1f} arcmin'
        for name, value in sorted(taken.items(), reverse=True))


class _EquinoxFit:
    """Fit of the mount model with the places of one equinox.

    After `fit`, ``misfit`` is minus the restricted log-likelihood, up to a constant that is the
    same for both equinoxes.
    """

    def __init__(self, place, reading, time, mount):
        self._mount, self._names = mount, mount.names.physical
        first, second = mount.axes_of(*place)
        first, second = through_pole(first, second, read_beyond(
            mount, (first, second), reading, np.isfinite(reading).all(axis=0)))
        self._first, self._second = first, second
        self._off = np.concatenate([wrap(reading[0] - first) * np.cos(second),
                                    wrap(reading[1] - second)])
        self._terms = stacked_design(self._names, first, second, mount)
        self._others, self._walks = self._columns(time)
        self._sizes = (-1.0, -1.0)
        self._p = np.zeros(len(self._names))
        self._radial = None

    def _columns(self, time):
        """Columns of the two groups: other terms, scaled to unit size, and drift of the zeros."""
        mount, n = self._mount, len(time)
        others = [name for name in terms_of(mount) if name not in (*self._names, 'TX3')]
        parts = [stacked_design(others, self._first, self._second, mount)]
        beyond = is_beyond(self._second)
        if min(beyond.sum(), n - beyond.sum()) > 2:
            parts.append(np.where(np.tile(beyond, 2), -1.0, 1.0) * self._terms)
        parts = np.concatenate(parts)
        since = (time - time.min()) / max(np.ptp(time), 1.0)
        # the Karhunen-Loeve series of a random walk
        order = np.arange(1, _MODES + 1)[:, None] - 0.5
        modes = np.tile(np.sin(order * np.pi * since) / order, 2)
        zeros = self._terms[[i for i, name in enumerate(self._names)
                             if mount.names.terms[name][0] in ('IA', 'IE')]]
        walks = np.concatenate([modes * zero for zero in zeros])
        return parts / np.sqrt(2.0 * np.mean(parts**2, axis=1, keepdims=True)), walks

    def _data(self):
        """Offsets in arcsec, less the second-order part of the model if the terms are known."""
        off = self._off
        if np.abs(self._p).max() < _FAR:
            exact = geometry.offsets(self._first, self._second, dict(zip(self._names, self._p)),
                                     self._mount)
            beyond = np.concatenate(exact) - self._p @ self._terms
            off = off - np.where(np.isfinite(beyond), beyond, 0.0)  # NaN: the mount cannot point
        return off / ARCSEC

    def fit(self, weights):
        """Fit the terms and the sizes of the groups with these row weights."""
        # slow to import, and few files lack their equinox
        from scipy.linalg import solve_triangular
        from scipy.optimize import minimize

        data, root = self._data(), np.sqrt(np.tile(weights, 2))
        groups = np.concatenate([self._others, self._walks])
        group = np.repeat([0, 1], [len(self._others), len(self._walks)])
        basis = np.linalg.qr((self._terms * root).T)[0]
        y, z = data * root, groups * root
        y, z = y - basis @ (basis.T @ y), z - (z @ basis) @ basis.T
        gram, both, square = z @ z.T, z @ y, float(y @ y)
        free = max(len(y) - len(self._names), 1)

        def solved(sizes):
            scale = np.exp(np.array(sizes))[group]
            lower = np.linalg.cholesky(np.eye(len(scale)) + scale[:, None] * gram * scale)
            u = solve_triangular(lower, scale * both, lower=True)
            variance = max(square - float(u @ u), 0.0) / free + _LEAST_NOISE**2
            return lower, u, scale, variance

        def misfit(sizes):
            lower, _, _, variance = solved(sizes)
            return float(np.log(np.diag(lower)).sum() + 0.5 * free * np.log(variance))
        found = minimize(misfit, self._sizes, method='L-BFGS-B', bounds=[_SIZES] * 2)
        self._sizes, self.misfit = tuple(found.x), float(found.fun)
        lower, u, scale, _ = solved(self._sizes)
        rest = data - (scale * solve_triangular(lower, u, lower=True, trans='T')) @ groups
        terms = np.linalg.lstsq((self._terms * root).T, rest * root, rcond=None)[0]
        self._p = terms * ARCSEC
        self._radial = np.hypot(*(rest - terms @ self._terms).reshape(2, -1))

    def weights(self):
        """Robust weights of the rows from the residuals, 1 for most rows."""
        return _weights(self._radial)

    def terms_alone(self):
        """Robust fit of the physical terms alone: terms, radians, and RMS residual, arcsec."""
        weights, self._p = np.ones(len(self._first)), np.zeros(len(self._names))
        for _ in range(5 * _ROUNDS):
            data, root = self._data(), np.sqrt(np.tile(weights, 2))
            terms = np.linalg.lstsq((self._terms * root).T, data * root, rcond=None)[0]
            radial = np.hypot(*(data - terms @ self._terms).reshape(2, -1))
            self._p, weights = terms * ARCSEC, _weights(radial)
        left = float(np.sqrt(np.mean(weights * radial**2) / weights.mean()))
        return dict(zip(self._names, self._p.tolist())), left


def _weights(radial):
    noise = max(float(np.median(radial)) / 1.1774, _LEAST_NOISE)
    return np.where(radial > _OUTLIER * noise, 1e-6, 1.5 / np.maximum(radial / noise, 1.5))
