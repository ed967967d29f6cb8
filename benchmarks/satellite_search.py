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

"""Search for causes of the errors in the paper's satellite check.

Each candidate of `satellite_candidates` is tried along every arc of a pass: which sizes reproduce
the four numbers of "after", which those of "before" with an additional zero offset, and which both,
on one arc before and one after. With one size parameter the result is an interval for each arc, in
closed form. With two, the two means of "after" determine them within their tolerance.
"""

from dataclasses import dataclass

import numpy as np
from satellite_candidates import (
    CANDIDATES,
    Assumptions,
    four_numbers,
    polaris_effects,
    track_effects,
)

from calibration.analysis.external_check import PAPER
from msg_tools.units import DEG
from pointing_model.sky.refraction import DEFAULT_WEATHER
from pointing_model.sky.satellite_passes import passes
from pointing_model.sky.satellite_place import satellite_place
from pointing_model.sky.site import DEFAULT_SITE

STEP = 30.0  # s between the samples of a pass
ARC_EVERY = 300.0  # s between the starts of arcs
ARC_MINUTES = (5, 10, 20, 30, 45, 60, 90, 120, 180, 240, 340)
DATES = 24  # over the year, for what depends on the season
_BOX, _TURNS, _KEPT, _TRIED = 7, 180, 1000, 41  # grids of sizes
_GAP = 0.1  # of the size: gaps below it come from the grid of arcs


@dataclass(frozen=True)
class CandidateResult:
    """Whether, and with which sizes, a candidate reproduces the paper's numbers.

    Attributes
    ----------
    name, cause : str
    units : tuple of str
        Of the sizes.
    after, before, both : bool
        Whether some size on some arc reproduces: the four numbers of "after"; the scatter of
        "before", and its means with a zero offset; both with the same size.
    one_night : bool
        Whether, in addition, the arc of "before" can end before that of "after" begins in one pass.
    size_after, size_before, size_both : tuple of list of (float, float)
        Intervals of each size; with two sizes the whole range of each. If any is within the limit,
        only these; for a fixed size, the values that it would need.
    known_after, known_both : bool
        Whether some size is within the limit known otherwise (`limit`, `reason`).
    limit : tuple of float
    reason : str
    best : dict or None
        The best size, its ``misfit`` (squared differences from the paper's numbers) and its arcs
        ``after`` and ``before``: ``start`` (UTC, s), ``minutes``, ``az_deg``, ``el_deg`` (first,
        last), the four numbers from the candidate alone, and for "before" the required zero offset.
    """

    name: str
    cause: str
    units: tuple
    after: bool
    before: bool
    both: bool
    one_night: bool
    size_after: tuple
    size_before: tuple
    size_both: tuple
    known_after: bool
    known_both: bool
    limit: tuple
    reason: str
    best: dict

    def to_dict(self):
        """JSON-ready dict."""
        return dict(vars(self))


@dataclass(frozen=True)
class _Arcs:
    """Every arc of some tracks: mean and covariance of the effects along it."""

    mean: np.ndarray  # (arcs, 2, k)
    covariance: np.ndarray  # (arcs, 2, k, k)
    track: np.ndarray
    first: np.ndarray
    last: np.ndarray

    def numbers(self, sizes):
        """Mean and std on each arc for sizes (m, k): two arrays (m, arcs, 2)."""
        mean = np.einsum('aik,mk->mai', self.mean, sizes)
        variance = np.einsum('mk,aikl,ml->mai', sizes, self.covariance, sizes)
        return mean, np.sqrt(np.maximum(variance, 0.0))


def _arcs(tracks, candidate, polaris):
    rows = []
    for number, (_, _, _, effects) in enumerate(tracks):
        values = np.array([effects[name] for name in candidate.effects]).transpose(1, 0, 2)
        zero = np.zeros(values.shape[:2])
        if candidate.zeroed:
            zero = np.array([polaris.get(n, (0.0, 0.0)) for n in candidate.effects]).T
        count = values.shape[2]
        centre = values.mean(axis=2)
        inside = values - centre[..., None]
        sums = _running(inside)
        squares = _running(inside[:, :, None] * inside[:, None])
        length = [min(round(60.0 * m / STEP), count) for m in ARC_MINUTES]
        every = round(ARC_EVERY / STEP)
        first = [np.arange(0, count - n + 1, every) for n in length if n >= 3]
        last = np.concatenate([f + n for f, n in zip(first, [n for n in length if n >= 3])])
        first = np.concatenate(first)
        n = last - first
        mean = (sums[..., last] - sums[..., first]) / n
        second = (squares[..., last] - squares[..., first]) / n
        second -= mean[:, :, None] * mean[:, None]
        mean += (centre - zero)[..., None]
        rows.append((np.moveaxis(mean, -1, 0), np.moveaxis(second, -1, 0),
                     np.full(len(first), number), first, last - 1))
    return _Arcs(*(np.concatenate(part) for part in zip(*rows)))


def _running(values):
    return np.concatenate([np.zeros((*values.shape[:-1], 1)), np.cumsum(values, axis=-1)], axis=-1)


class _Search:
    """Search for sizes of a candidate that reproduce the published numbers on some arc."""

    def __init__(self, tracks, candidate, polaris, published, assumptions):
        self.tracks = tracks
        self.arcs = arcs = _arcs(tracks, candidate, polaris)
        self.start, self.end = (
            np.array([tracks[t][0][i] for t, i in zip(arcs.track, which)])
            for which in (arcs.first, arcs.last))
        self.published = published
        (self.mean, self.tolerance, self.most_after, self.least_before,
         self.most_before) = assumptions.windows(published)
        self.drift = assumptions.drift_arcsec

    def after_score(self, sizes):
        """Misfit of "after" to the paper's numbers, inf if outside the tolerance: (m, arcs)."""
        mean, std = self.arcs.numbers(sizes)
        off = (mean - self.mean) / self.tolerance
        paper = four_numbers(self.published['after'], 'std')
        score = np.sum(off**2 + (std / paper - 1.0) ** 2, axis=2)
        slack = 1.0 + 1e-9
        good = np.all((np.abs(off) <= slack) & (std <= slack * self.most_after), axis=2)
        return np.where(good, score, np.inf)

    def before_score(self, sizes):
        """The same for "before", where a free zero offset reproduces the means."""
        mean, std = self.arcs.numbers(sizes)
        zero = four_numbers(self.published['before'], 'mean') - mean
        score = np.sum((std / four_numbers(self.published['before'], 'std') - 1.0) ** 2, axis=2)
        slack = 1.0 + 1e-9
        good = np.all((np.abs(zero) <= slack * self.drift) & (slack * std >= self.least_before)
                      & (std <= slack * self.most_before), axis=2)
        return np.where(good, score, np.inf)

    def describe(self, size, number):
        """Description of one arc, with the numbers from the candidate."""
        _, az, el, _ = self.tracks[self.arcs.track[number]]
        ends = [self.arcs.first[number], self.arcs.last[number]]
        mean, std = (v[0, number] for v in self.arcs.numbers(size[None]))
        return {
            'start': float(self.start[number]),
            'minutes': float((self.end[number] - self.start[number]) / 60.0),
            'az_deg': [float(v / DEG) for v in az[ends]],
            'el_deg': [float(v / DEG) for v in el[ends]],
            'az_mean_arcsec': float(mean[0]), 'az_std_arcsec': float(std[0]),
            'el_mean_arcsec': float(mean[1]), 'el_std_arcsec': float(std[1]),
        }

    def also_before(self, sizes):
        """The sizes, of (m, k), that reproduce "before" on some arc."""
        return sizes[np.isfinite(self.before_score(sizes)).any(axis=1)]

    # one size: intervals on every arc, closed

    def one_after(self):
        with np.errstate(divide='ignore'):
            ends = np.stack([(self.mean - self.tolerance) / self.arcs.mean[..., 0],
                             (self.mean + self.tolerance) / self.arcs.mean[..., 0]])
            most = self.most_after / self._spread()
        low = np.max([ends.min(0).max(1), -most.min(1)], axis=0)
        high = np.min([ends.max(0).min(1), most.min(1)], axis=0)
        return _merged(low, high)

    def one_before(self):
        middle = four_numbers(self.published['before'], 'mean')
        with np.errstate(divide='ignore', invalid='ignore'):
            ends = np.stack([(middle - self.drift) / self.arcs.mean[..., 0],
                             (middle + self.drift) / self.arcs.mean[..., 0]])
            least = np.nanmax(self.least_before / self._spread(), axis=1)
            most = np.nanmin(self.most_before / self._spread(), axis=1)
        # drift is larger than the means: 0 is inside, and the ends have both signs
        high, low = ends.max(0).min(1), ends.min(0).max(1)
        return _merged(np.concatenate([least, np.maximum(low, -most)]),
                       np.concatenate([np.minimum(high, most), -least]))

    def _spread(self):
        return np.sqrt(np.maximum(self.arcs.covariance[..., 0, 0], 0.0))

    # two sizes: the means fix them on every arc, up to their tolerance

    def two_after(self):
        grid = np.linspace(-1.0, 1.0, _BOX)
        box = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
        target = self.mean + self.tolerance * box
        matrix = self.arcs.mean
        scale = np.abs(matrix).max(axis=2).prod(axis=1)
        determinant = np.linalg.det(matrix)
        solid = np.abs(determinant) > 1e-6 * scale
        if not solid.any():
            return np.empty((0, 2))
        sizes = np.einsum('aki,bi->abk', np.linalg.inv(matrix[solid]), target)
        variance = np.einsum('abk,aikl,abl->abi', sizes, self.arcs.covariance[solid], sizes)
        return sizes[np.all(variance <= self.most_after**2 * (1.0 + 1e-9), axis=2)]

    def two_before(self):
        turn = np.linspace(0.0, 2.0 * np.pi, _TURNS, endpoint=False)
        scale = np.sqrt(np.einsum('aikk->k', self.arcs.covariance))
        direction = np.stack([np.cos(turn), np.sin(turn)], axis=1) / np.maximum(scale, 1e-12)
        mean, std = self.arcs.numbers(direction)
        middle = four_numbers(self.published['before'], 'mean')
        with np.errstate(divide='ignore', invalid='ignore'):
            least = np.nanmax(self.least_before / std, axis=2)
            most = np.nanmin(self.most_before / std, axis=2)
            ends = np.stack([(middle - self.drift) / mean, (middle + self.drift) / mean])
        most = np.minimum(most, np.nanmin(ends.max(0), axis=2))
        which, arc = np.nonzero((least <= most) & np.isfinite(most))
        sizes = [direction[which] * size[which, arc][:, None] for size in (least, most)]
        return np.concatenate(sizes)


def _merged(low, high):
    """Union of intervals as disjoint intervals."""
    good = low <= high
    out = []
    for a, b in sorted(zip(low[good], high[good])):
        if out and a <= out[-1][1]:
            out[-1][1] = max(out[-1][1], b)
        else:
            out.append([a, b])
    return [(float(a), float(b)) for a, b in out]


def _closed(intervals):
    """Close the gaps between intervals that come from the grid of arcs."""
    out = []
    for a, b in intervals:
        if out and a - out[-1][1] <= _GAP * max(abs(a), abs(out[-1][1])):
            out[-1] = (out[-1][0], max(b, out[-1][1]))
        else:
            out.append((a, b))
    return out


def _common(first, second):
    pairs = [(max(a, c), min(b, d)) for a, b in first for c, d in second]
    return _merged(*np.array(pairs).reshape(-1, 2).T)


def _ranges(sizes):
    return tuple([(float(s.min()), float(s.max()))] if s.size else [] for s in sizes.T)


def _spread_out(intervals):
    """Grid of sizes in the intervals, to search for the best."""
    sizes = [np.linspace(a, b, _TRIED) for a, b in intervals]
    return np.unique(np.concatenate([*sizes, np.empty(0)]))[:, None]


def _judge(candidate, searches):
    """`searches`: one for each season that is tried; before and after are in the same."""
    limit = np.array(candidate.limit)
    if len(candidate.effects) == 1:
        wanted = [(candidate.fixed,) * 2] if candidate.fixed is not None else None
        allowed = wanted or [(-limit[0], limit[0])]
        every = [(a, b, _common(a, b))
                 for a, b in ((s.one_after(), s.one_before()) for s in searches)]
        parts = [_merged(*np.array([i for e in part for i in e]).reshape(-1, 2).T)
                 for part in zip(*every)]
        known = [_common(part, allowed) for part in parts]
        fits = known if wanted else parts
        ranges = [(_closed(inside if inside and not wanted else part),)
                  for part, inside in zip(parts, known)]
        # sizes to look for the best: both if there are, and as far as known
        kind = 2 if fits[2] else 0
        sizes = [_spread_out(_common(e[kind], allowed) if known[kind] else
                             [] if wanted else e[kind]) for e in every]
    else:
        search, = searches
        every, before = search.two_after(), _inside(search.two_before(), limit)
        after = _thinned(_inside(every, limit))
        joint = search.also_before(after)
        if not len(joint):
            joint = search.also_before(_thinned(every))
        fits = after, before, joint
        known = [part[np.all(np.abs(part) <= limit, axis=1)] for part in fits]
        ranges = [_ranges(part) for part in fits]
        sizes = [joint if len(joint) else after]
    both = len(fits[2]) > 0
    best = [_best(search, rows, both) for search, rows in zip(searches, sizes) if len(rows)]
    best = [found for found in best if found]
    one_night = any(found.pop('one_night') for found in best)
    return CandidateResult(
        candidate.name, candidate.cause, candidate.units, *(len(part) > 0 for part in fits),
        one_night, *ranges, len(known[0]) > 0, len(known[2]) > 0, candidate.limit,
        candidate.reason, min(best, key=lambda found: found['misfit'], default=None))


def _inside(sizes, limit):
    """Those within the limit, or all if none is."""
    good = np.all(np.abs(sizes) <= limit, axis=1)
    return sizes[good] if good.any() else sizes


def _thinned(sizes):
    return sizes[np.linspace(0, len(sizes) - 1, min(len(sizes), _KEPT)).astype(int)]


def _best(search, sizes, joint):
    after = search.after_score(sizes)
    before = search.before_score(sizes) if joint else np.zeros((len(sizes), 1))
    total = after.min(axis=1) + before.min(axis=1)
    i = int(np.argmin(total))
    if not np.isfinite(total[i]):  # on the edge of an interval
        return None
    out = {'size': [float(s) for s in sizes[i]], 'misfit': float(total[i]), 'one_night': False,
           'after': search.describe(sizes[i], int(np.argmin(after[i]))), 'before': None}
    if joint:
        out['before'] = search.describe(sizes[i], int(np.argmin(before[i])))
        for axis in ('az', 'el'):
            out['before'][f'zero_{axis}_arcsec'] = (
                search.published['before'][f'{axis}_mean_arcsec']
                - out['before'][f'{axis}_mean_arcsec'])
        ends = np.where(np.isfinite(before), search.end, np.inf).min(axis=1)
        starts = np.where(np.isfinite(after), search.start, -np.inf).max(axis=1)
        out['one_night'] = bool(np.any(ends < starts))
    return out


def candidate_report(satellite, start=None, *, site=DEFAULT_SITE, weather=DEFAULT_WEATHER,
                     published=PAPER, assumptions=None, candidates=CANDIDATES):
    """Which causes may have left the numbers of the satellite check.

    Parameters
    ----------
    satellite : Satellite
    start : float, optional
        UTC, seconds since 1970-01-01: passes of the day from here (a GPS satellite repeats them
        every sidereal day); by default from the elements' epoch. Effects that depend on the
        season are tried on 24 nights around it, half a year to each side.
    site : Site
    weather : Weather
    published : dict
        As `PAPER`.
    assumptions : Assumptions, optional
    candidates : sequence of Candidate

    Returns
    -------
    list of CandidateResult

    Raises
    ------
    ValueError
        The satellite does not rise above 20 degrees on that day.
    """
    assumptions = assumptions or Assumptions()
    start = satellite.epoch if start is None else start
    tracks = _tracks(satellite, [start], site, weather, assumptions)
    if not tracks:
        raise ValueError(f'satellite {satellite.number} has no pass above 20 degrees on that day: '
                         'take another day or site')
    seasonal = []
    if any('annual' in candidate.effects for candidate in candidates):
        days = np.linspace(-182.0, 182.0, DATES, endpoint=False)
        seasonal = _tracks(satellite, start + 86400.0 * days, site, weather, assumptions,
                           dark=True)
    polaris = polaris_effects(site, weather)
    out = []
    for candidate in candidates:
        seasons = [[one] for one in seasonal] if 'annual' in candidate.effects else [tracks]
        out.append(_judge(candidate, [
            _Search(group, candidate, polaris, published, assumptions) for group in seasons]))
    return out


def _tracks(satellite, starts, site, weather, assumptions, dark=False):
    """Passes as (time, az, el, effects)."""
    out = []
    for start in starts:
        for one in passes(satellite, float(start), 24.0, site, dark=dark):
            time = np.arange(one.start, one.end, STEP)
            if len(time) < 2 * round(60.0 * ARC_MINUTES[0] / STEP):
                continue
            az, el, _ = satellite_place(satellite, time, site, weather)
            effects = track_effects(satellite, time, site, weather)
            if assumptions.on_sky:
                effects = {name: (a * np.cos(el), e) for name, (a, e) in effects.items()}
            out.append((time, az, el, effects))
    return out


def report_rows(results):
    """Rows for people.

    Parameters
    ----------
    results : list of CandidateResult

    Returns
    -------
    header : list of str
    rows : list of list of str
    """
    header = ['candidate', 'size for "after"', 'for "before"', 'for both', 'in one night',
              'within what is known']
    rows = []
    for r in results:
        known = 'both' if r.known_both else 'after' if r.known_after else 'no'
        rows.append([r.name, *(
            _text(part, r.units) if part[0] else 'none'
            for part in (r.size_after, r.size_before, r.size_both)),
            'yes' if r.one_night else 'no' if r.both else '', known])
    return header, rows


def _text(ranges, units):
    return '; '.join(
        ', '.join(f'{a:.3g} to {b:.3g}' for a, b in intervals) + f' {unit}'
        for intervals, unit in zip(ranges, units))
