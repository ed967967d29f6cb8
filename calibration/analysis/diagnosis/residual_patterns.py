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

"""Patterns in the residuals of a smooth model: repeated visits, clusters of outliers, jumps.

They name no cause and need none. They use the residuals of the terms alone, which change little
within a few degrees, and p-values from permutations.
"""

from typing import NamedTuple

import numpy as np

from calibration.estimation.correlated_noise import Sequence, WhiteNoise
from calibration.estimation.group_columns import GroupColumns
from calibration.estimation.lag_correlation import lag_correlation
from calibration.estimation.outlier_clusters import Window, clusters
from calibration.estimation.revisits import SAME_PLACE, Revisits
from calibration.estimation.step_scan import step_place
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.context import Context
from pointing_model.mounts import is_beyond
from pointing_model.pointing_terms import stacked_design
from pointing_model.rms import sigma_of

from ..finding import Finding
from .observations import sequence_of
from .row_counts import row_word

#: fewest differences between visits to report the noise (ten give it to a fifth); fewest rows to
#: search for clusters of outliers
_FEWEST, _FEW = 10, 18
#: largest number of rows used
MOST_ROWS = 5000
#: kinds of findings on motion
STEP = 'step between visits'
MOVES = (STEP, 'moved between visits')
#: rad: smaller residuals are rounding errors, not noise
_ROUNDING = 1e-6 * ARCSEC
#: largest p-value of the correlation between consecutive rows of an axis; residuals are clipped at
#: this many robust sigmas
_BY_CHANCE, _AT_MOST = 1e-3, 3.0
#: a jump of the zeros must reduce the RMS by this factor (a linear drift reduces it to a half; no
#: false alarm in 2250 runs of white noise, walks, drifts and heavy tails); fewest rows on either
#: side; fewest degrees of freedom
_FALL, _SIDE, _FREE = 3.0, 3, 6
#: kinds of windows in position
_OF_PLACE = ('direction', 'azimuth', 'first axis')
#: robust sigmas from which a row is an outlier in the search for clusters
_FAR = 4.0
#: rows of one star err alike if their correlation is this many standard errors, and the errors of
#: the terms are larger by this ratio
_ALIKE, _LARGER = 5.0, 1.2
#: RMS of rounding, relative to what a fit leaves: from the first on it is named; beyond the second
#: the written values must be exact
_MOSTLY, _EXACT = 0.7, 1.3
#: radii, rad, of windows around a row: in direction, in azimuth
_ABOUT, _ASIDE = (3.0 * DEG, 6.0 * DEG), (3.0 * DEG, 6.0 * DEG)
#: lengths of windows in time, rows
_LENGTHS = (3, 4, 5, 6, 8, 12)
#: largest number of rows with windows around them; twice as many windows in time
_CENTRES = 250


class ResidualRows(NamedTuple):
    """Rows and their residuals.

    Attributes
    ----------
    context : Context
        Context of n rows.
    sequence : Sequence
    lines : ndarray, shape (n,)
        Labels of the rows for users.
    residual : ndarray, shape (2, n)
        Radians on the sky, finite.
    word : {'row', 'line'}
    sigma : ndarray, shape (2, n), optional
        Given noise.
    """

    context: Context
    sequence: Sequence
    lines: np.ndarray
    residual: np.ndarray
    word: str = 'row'
    sigma: np.ndarray | None = None

    @classmethod
    def from_fit(cls, run, result, encoder='enc'):
        """From the rows of a `FitResult` with residuals; if many, an evenly spaced sample."""
        rows = np.flatnonzero(np.isfinite(result.residual_x) & np.isfinite(result.residual_y))
        rows = rows[::-(-len(rows) // MOST_ROWS) or 1]
        used = run.select(rows)
        label = np.unique(used['run'], return_inverse=True)[1] if 'run' in run else np.zeros(
            len(rows), int)
        sigma = np.array([used.get('sigma_x'), used.get('sigma_y')], float)
        context = Context.from_run(used, encoder)
        return cls(context, sequence_of(context, label), run.lines[rows],
                   np.array([result.residual_x, result.residual_y])[:, rows],
                   row_word(run),
                   sigma if np.isfinite(sigma).all() and (sigma > 0.0).all() else None)

    @classmethod
    def from_observations(cls, obs, residual):
        """From `Observations` and their residuals, x then y, shape (2n,) or (2, n)."""
        sigma = None if obs.inverse_sigma is None else 1.0 / obs.inverse_sigma.reshape(2, -1)
        return cls(obs.context, obs.sequence, obs.places, residual.reshape(2, -1),
                   row_word(obs.run), sigma)

    def visits(self, terms, own_zeros=False):
        """The `Revisits` of the rows.

        Parameters
        ----------
        terms : sequence of str
            Terms fitted to give the residuals.
        own_zeros : bool
            Whether each run has separate zeros.
        """
        context, sequence, mount = self.context, self.sequence, self.context.mount
        n = len(context)
        # without UTC keep the runs in file order: their clocks cannot be compared
        timed = sequence.timed and (context.time_is_utc or not sequence.run.any())
        position = sequence.position if timed else np.argsort(sequence.order) * 1.0
        columns, index = (stacked_design(names, context.az, context.el, mount)
                          for names in (terms, mount.names.index))
        return Revisits(
            context.direction(), position, self.residual, SAME_PLACE,
            (columns[:, :n], columns[:, n:]), np.array([index[0, :n], index[1, n:]]),
            sequence.group, is_beyond(context.el).astype(int), sequence.run if own_zeros else None)


def visit_findings(rows, visits):
    """Noise and motion from repeated visits to the same places.

    Parameters
    ----------
    rows : ResidualRows
    visits : Revisits

    Returns
    -------
    list of Finding
        One, or none if too few places were visited repeatedly.
    """
    names, move = rows.context.mount.names, visits.move
    if move is None and visits.differences < _FEWEST:
        return []
    known = {'places': visits.places, 'radius_deg': SAME_PLACE / DEG, 'axes': names.axes,
             'zeros': visits.zeros,
             'noise_arcsec': tuple((visits.noise / ARCSEC).tolist()),
             'left_arcsec': tuple(float(sigma_of(one)) / ARCSEC for one in rows.residual)}
    if move is None:
        return [Finding('places visited again', evidence=known)]
    return [Finding(STEP if visits.at_once else MOVES[1],
                    move.amount / ARCSEC, move.sigma / ARCSEC, caution=True, evidence={
                        **known, 'axis': names.axes[move.axis], 'word': rows.word,
                        'term': names.index[move.axis], 'both': move.both,
                        'before': rows.lines[move.before], 'after': rows.lines[move.after],
                        'chance': move.chance})]


def memory_findings(rows, terms):
    """Test whether rows of one star within minutes err alike, and consecutive stars.

    Parameters
    ----------
    rows : ResidualRows
    terms : sequence of str
        Terms fitted to give the residuals.

    Returns
    -------
    list of Finding
        One of each, or none.
    """
    order, names = rows.sequence.order, rows.context.mount.names
    weights = np.ones((2, len(order))) if rows.sigma is None else 1.0 / rows.sigma
    values = rows.residual * weights
    noise = np.array([[sigma_of(one)] for one in values])
    if not len(order) or min(map(sigma_of, rows.residual)) < _ROUNDING:
        return []
    columns = stacked_design(terms, rows.context.az, rows.context.el, rows.context.mount)
    both = np.concatenate((np.clip(values / noise, -_AT_MOST, _AT_MOST)[None],
                           columns.reshape(len(terms), 2, -1) * weights))[:, :, order]
    _, first, star, count = np.unique(rows.sequence.group[order], return_index=True,
                                      return_inverse=True, return_counts=True)
    place = np.argsort(first)
    means = np.zeros((*both.shape[:2], len(first)))
    np.add.at(means, (slice(None), slice(None), star), both)
    means = means / count
    out = _of_one_star(both[0], means[0][:, star], count)
    means = means[:, :, place]
    run = rows.sequence.run[order][first[place]]
    found = [(axis, *one) for axis, one in enumerate(lag_correlation(
        means[0], means[1:], run[1:] == run[:-1]))]
    found = [(axis, beyond) for axis, beyond, chance in found if chance < _BY_CHANCE]
    return [*out, Finding(
        'consecutive rows alike', max(beyond for _, beyond in found), unit='', caution=True,
        evidence={'terms': [names.index[axis] for axis, _ in found if names.index[axis] in terms],
                  'axes': [names.axes[axis] for axis, _ in found]})] if found else out


def _of_one_star(values, means, count):
    """Finding on rows of one star that err alike: how much larger errors are than uncorrelated.

    See Kish 1965, Survey Sampling, section 5.4.

    Parameters
    ----------
    values, means : ndarray, shape (2, n)
        Residuals, and the mean of the star of each.
    count : ndarray of int
        Rows of each star.
    """
    n, size = count.sum(), np.square(count).sum() / count.sum()
    if n == len(count) or len(count) < 3:
        return []
    alike = 1.0 - np.square(values - means).sum() / np.square(values).sum() * n / (n - len(count))
    ratio = float(np.sqrt(1.0 + (size - 1.0) * max(alike, 0.0)))
    if alike * np.sqrt(len(count) * size * (size - 1.0)) < _ALIKE or ratio < _LARGER:
        return []
    return [Finding('rows of one star alike', ratio, unit='', caution=True,
                    evidence={'r': float(alike)})]


def jump_findings(rows, terms):
    """A jump of the zeros too large for the terms to absorb; needs no repeated visits.

    Parameters
    ----------
    rows : ResidualRows
    terms : sequence of str
        Terms fitted to give the residuals.

    Returns
    -------
    list of Finding
        One or none; its size is the jump of the axis that jumps more.
    """
    names, n = rows.context.mount.names, len(rows.context)
    if not set(names.index) <= set(terms) or 2 * n < len(terms) + 2 + _FREE or n < 2 * _SIDE:
        return []
    columns, index = (stacked_design(some, rows.context.az, rows.context.el, rows.context.mount)
                      for some in (terms, names.index))
    unit = np.array([index[0, :n], index[1, n:]])
    order = rows.sequence.order
    near = np.zeros(n, bool)
    near[order[_SIDE - 1:n - _SIDE + 1]] = True
    place = step_place(columns.reshape(len(terms), 2, n), unit, rows.residual,
                       np.argsort(order) * 1.0, near)
    steps = np.zeros((2, 2, n))
    steps[[0, 1], [0, 1]] = unit * place.later
    with_it = np.concatenate((columns, steps.reshape(2, -1)))
    value = rows.residual.ravel()
    after = GroupColumns.alone(with_it).left_of(value, WhiteNoise(np.ones(2 * n))).reshape(2, n)
    good = np.hypot(*after) <= _FAR * np.sqrt(2.0) * max(map(sigma_of, after))
    rms = []
    for design in (columns, with_it):
        white = WhiteNoise(np.tile(good, 2).astype(float))
        left = GroupColumns.alone(design).left_of(value, white).reshape(2, n)[:, good]
        rms.append(np.sqrt(2.0 * np.square(left).sum()
                           / max(2 * np.count_nonzero(good) - len(design), 1)))
    run = rows.sequence.run
    if (rms[0] < max(_FALL * rms[1], _ROUNDING) or np.count_nonzero(~good) > n // 4
            or run[place.before] != run[place.after]):  # reported elsewhere as runs fitted as one
        return []
    axis = int(np.argmax(np.abs(place.amounts)))
    return [Finding('zeros jumped', place.amounts[axis] / ARCSEC, before=rms[0] / ARCSEC,
                    after=rms[1] / ARCSEC, caution=True, evidence={
                        'axis': names.axes[axis], 'word': rows.word,
                        'before': rows.lines[place.before], 'after': rows.lines[place.after]})]


def rounding_findings(meta, left):
    """Columns written in steps so coarse that rounding explains most of what a fit leaves.

    Parameters
    ----------
    meta : dict
        Of the run, with ``steps``: see `pointing_model.runs.columns.written_steps`.
    left : float
        Radial RMS corrected for degrees of freedom, arcsec.

    Returns
    -------
    list of Finding
        One or none.
    """
    steps = [one for one in meta.get('steps', ()) if one['rms_arcsec'] < _EXACT * left]
    total = float(np.linalg.norm([one['rms_arcsec'] for one in steps]))
    if total < _MOSTLY * max(left, 1e-9):
        return []
    return [Finding('coarse columns', total, after=left, caution=True, evidence={
        'steps': [one for one in steps if one['rms_arcsec'] > 0.3 * total]})]


def step_finding(rows, visits, least=0.0):
    """A step in time between repeated visits to the same places.

    Parameters
    ----------
    rows : ResidualRows
    visits : Revisits
    least : float
        Smallest step, in units of the noise of one visit.

    Returns
    -------
    Finding or None
    """
    move = visits.move
    if move is None or abs(move.amount) < least * visits.noise[move.axis] or not visits.at_once:
        return None
    return visit_findings(rows, visits)[0]


def cluster_findings(rows):
    """Clusters of outliers: in direction, in time, of one star, or on one side of the pier.

    Parameters
    ----------
    rows : ResidualRows

    Returns
    -------
    list of Finding
    """
    return [_cluster_finding(rows, one) for one in _clusters(rows)]


def gathered(rows):
    """Clusters of outliers in direction or in the angle of the first axis.

    They may be due to an effect that acts on few rows only.

    Parameters
    ----------
    rows : ResidualRows

    Returns
    -------
    list of ndarray of int
    """
    return [one.rows for one in _clusters(rows) if one.window.what in _OF_PLACE]


def _clusters(rows):
    scaled = rows.residual if rows.sigma is None else rows.residual / rows.sigma
    noise = np.array([[sigma_of(one)] for one in scaled])
    if len(rows.context) < _FEW or not (noise > 0.0).all():
        return []
    scaled = scaled / noise
    axis = np.argmax(np.abs(scaled), axis=0)
    worst = np.take_along_axis(scaled, axis[None], axis=0)[0]
    kind = np.where(np.abs(worst) > _FAR, np.sign(worst) * (1 + axis), 0).astype(int)
    if np.unique(kind[kind != 0], return_counts=True)[1].max(initial=0) < 3:
        return []
    return clusters(kind, [*_windows(rows)], np.random.default_rng(0))


def _windows(rows):
    """Windows in which clusters of outliers are searched."""
    context, n = rows.context, len(rows.context)
    centres = np.arange(n)[::-(-n // _CENTRES)]
    direction = context.direction()
    along = direction[:, centres].T @ direction
    for size in _ABOUT:
        yield from (Window('direction', np.flatnonzero(one)) for one in along >= np.cos(size))
    angles = {'azimuth': context.on_horizon()[0]}
    if not context.mount.vertical:
        angles['first axis'] = context.az
    for what, angle in angles.items():
        aside = np.abs(wrap(angle[centres, None] - angle))
        for size in _ASIDE:
            yield from (Window(what, np.flatnonzero(one)) for one in aside <= size)
    order = rows.sequence.order
    for length in _LENGTHS:
        yield from (Window('time', order[i:i + length])
                    for i in range(0, n - length + 1, -(-n // (2 * _CENTRES))))
    star = context.columns.get('star')
    if star is not None:
        each = np.unique(star, return_inverse=True)[1]
        yield from (Window('star', np.flatnonzero(each == k))
                    for k in np.flatnonzero(np.bincount(each) > 2))
    beyond = is_beyond(context.el)
    if beyond.any() and not beyond.all():
        yield from (Window('side', np.flatnonzero(one)) for one in (beyond, ~beyond))


def _cluster_finding(rows, found):
    context, names = rows.context, rows.context.mount.names
    mine, axis = found.rows, abs(found.kind) - 1
    azimuth, elevation = (angle[mine] for angle in context.on_horizon())
    direction = context.direction()[:, mine]
    middle = direction.mean(axis=1) / np.linalg.norm(direction.mean(axis=1))
    sizes = rows.residual[axis, mine] / ARCSEC
    star = context.columns.get('star')
    about = np.arctan2(np.sin(azimuth).mean(), np.cos(azimuth).mean())
    first = context.az[mine]
    return Finding(
        'outliers together', float(np.median(sizes)), caution=True, evidence={
            'axis': names.axes[axis], 'word': rows.word, 'what': found.window.what,
            'rows': [rows.lines[i] for i in mine], 'of': len(found.window.rows),
            'azimuth_deg': float(np.mod(np.degrees(about), 360.0)),
            'aside_deg': float(np.degrees(np.abs(wrap(azimuth - about)).max())),
            'elevation_deg': tuple(np.degrees([elevation.min(), elevation.max()]).tolist()),
            'radius_deg': float(np.degrees(np.arccos(np.clip(middle @ direction, -1, 1)).max())),
            'first_deg': tuple(np.degrees([first.min(), first.max()]).tolist()),
            'first_axis': names.axes[0],
            'star': None if star is None else str(star[mine[0]]), 'chance': found.chance,
            'side': bool(is_beyond(context.el[mine[0]]))})
