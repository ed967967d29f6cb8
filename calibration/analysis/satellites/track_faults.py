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

"""Rejection of passes that disagree with all others, and of satellites with a wrong orbit.

A pass that is off by far more than the scatter of its rows has a wrong stamp, satellite or
power-on. The pass without which the others agree best is rejected, until they agree. Then three
equally likely hypotheses are compared by their marginal likelihood over mount, clock, orbits and
noise: no orbit is wrong; one satellite is off along its track, by a constant or drifting amount of
any size; or something common to all is wrong (site, refraction, a clock assumed to be known). An
orbit with nearly all of the posterior probability is rejected, a common error with as much is
fitted, and the others are tested again. If several share it, they are reported as suspects, and
the terms are the mean over them.
The age of elements and their expected error are reported, too.
"""

from collections import Counter, defaultdict
from dataclasses import replace

import numpy as np

from msg_tools.units import ARCSEC

from ...estimation.prior_fit import PriorFit, gram_of
from ...estimation.step_scan import probabilities
from ..finding import Finding
from .stamp_check import robustly_off
from .track_columns import CLOCK, COMMON_SIZES
from .track_fit import fit_tracks

#: posterior probability from which something is wrong
SURE = 0.98
#: RMS errors along the track of a wrong orbit
_SIZES = tuple(size * ARCSEC for size in (5.0, 10.0, 20.0, 40.0, 80.0, 160.0, 320.0))
#: fewest passes that must be left
_PASSES = 2
#: sizes of common errors, relative to `COMMON_SIZES`
_COMMON_PARTS = np.array([0.01, 0.03, 0.1, 0.3, 1.0])
#: RMS deviation of a rejected pass, in sigmas of the white noise of its rows (correlated noise adds
#: less); the same before wrong orbits are known, rad: these are off by less
_FAR, _GROSS = 6.0, 500.0 * ARCSEC
#: share of outliers from which a pass is rejected
_MOST_LOST = 0.5
#: rows are elsewhere if off by more than this times the median row; smallest share of a pass
_TIMES, _PART = 10.0, 0.25


def elements_age(orbit, time):
    """A Finding on the age of elements at some times, shape (n,), and their expected error."""
    return Finding('old elements', (time.mean() - orbit.epoch) / 86400.0, unit='days',
                   causes=(orbit.name,),
                   evidence={'error_km': float(np.max(orbit.sigma(time))) / 1e3})


def fault_chances(tracks, wrong=(), **options):
    """Posterior probability of each orbit and of each common error to be what is wrong.

    Parameters
    ----------
    tracks : SatelliteTracks
    wrong : tuple of str
        Common errors that are fitted already.
    **options
        See `track_fit.fit_tracks`.

    Returns
    -------
    dict of str to float
        By satellite, common error of `COMMON_SIZES`, '' for none; they sum to 1.
    """
    names, known = tracks.satellites, np.isfinite(options.get('clock_sigma', np.inf))
    shared = () if wrong else (*tracks.common, *([CLOCK] if known else ()))
    # estimate the noise with all faults allowed, so that a fault does not enlarge it
    full = fit_tracks(tracks, wrong=wrong + names + shared, **options)
    columns, prior = full.columns, full.precision
    left, mean = _before_orbits(full)
    faults = [(name, *columns.drifts[name], _SIZES, len(names)) for name in names]
    faults += [(name, _at(columns, f'common {name}'), np.eye(1),
                COMMON_SIZES[name] * _COMMON_PARTS, len(shared)) for name in shared]
    plain = np.ones(len(columns.names), bool)
    for _, part, *_ in faults:
        plain[part] = False
    # an orbit early or late by a constant is one number, like a common error
    faults += [(name, _at(columns, f'ahead {name}'), columns.drifts[name][1][:1, :1], _SIZES,
                len(names)) for name in names if name not in options.get('bias_free', ())]
    cases = [('', plain, prior, 0.0)]
    for name, part, covariance, sizes, rivals in faults:
        kept = plain.copy()
        kept[part] = True
        log_det = np.linalg.slogdet(covariance)[1]
        if plain[part].all():  # it has a prior without a fault, too
            log_det += np.log(prior[part, part].item())
        shapes = sum(name == one for one, *_ in faults)
        for size in sizes:
            precision = prior.copy()
            precision[part, part] = np.linalg.inv(covariance) / size**2
            cases.append((name, kept, precision, -0.5 * log_det - np.log(
                size**len(covariance) * len(sizes) * rivals * shapes)))
    logs = defaultdict(list)
    for noise, chance in full.noises:
        gram = gram_of(noise.whiten(columns.columns), noise.whiten(left))
        # `chance` is the posterior of this noise with all faults allowed
        base = np.log(chance) - PriorFit(gram, noise.count, prior, mean).evidence
        for name, kept, precision, log_prior in cases:
            rows = np.append(np.flatnonzero(kept), len(kept))
            own = PriorFit(gram[np.ix_(rows, rows)], noise.count,
                           precision[np.ix_(kept, kept)], mean[kept])
            logs[name].append(base + own.evidence + log_prior)
    return probabilities({name: float(np.logaddexp.reduce(each)) for name, each in logs.items()})


def _at(columns, name):
    place = columns.place(name)
    return slice(place, place + 1)


def _before_orbits(fit):
    """Residuals with the terms only, shape (2n,), and the prior mean relative to the fit."""
    mean = fit.prior_mean - fit.values
    mean[fit.columns.terms:] = 0.0
    return (fit.after + fit.columns.orbits(fit.values)).ravel(), mean


def _without_strays(tracks, least, **options):
    """Reject passes far from the prediction of all others, or with mostly outliers.

    If most passes of a satellite are off, but by less than `least` (rad on the sky), they are not
    rejected: its orbit may be wrong. Returns the other tracks, and a Finding for each rejected
    pass: its deviation, rad (NaN if rejected for its outliers).
    """
    out, passes = [], np.unique(tracks.arc[~tracks.is_star])
    fit, known = fit_tracks(tracks, **options), options.get('held') is not None
    alone = len(passes) + bool(tracks.is_star.any()) + known
    for arc in passes:
        rows = tracks.arc == arc
        if np.mean(fit.weights[rows] == 0.0) > _MOST_LOST and alone - len(out) > 1:
            out.append(_pass_finding(tracks, arc, np.nan))
    columns, root, prior = fit.columns, fit.noises[0][0].root, fit.precision
    left, mean = _before_orbits(fit)
    used = {arc: np.flatnonzero(np.tile(tracks.arc == arc, 2) & (root > 0.0))
            for arc in np.unique(tracks.arc)}
    grams = {arc: gram_of(columns.columns[:, rows] * root[rows], left[rows] * root[rows])
             for arc, rows in used.items()}
    for one in out:
        grams.pop(one.evidence['arc'])
    while sum(arc in passes for arc in grams) + (alone - len(passes)) > _PASSES:
        whole = sum(grams.values())
        square = PriorFit(whole, 0, prior, mean).square
        off = {}
        for arc in set(grams) & set(passes.tolist()):
            others, rows = PriorFit(whole - grams[arc], 0, prior, mean), used[arc]
            far = left[rows] - others.coefficients @ columns.columns[:, rows]
            off[arc] = ((square - others.square) / max(len(rows), 1),
                        float(np.sqrt(2.0 * np.mean(far**2))) if len(rows) else 0.0)
        arc = max(off, key=lambda one: off[one][0])
        if off[arc][0] < _FAR**2:
            break
        out.append(_pass_finding(tracks, arc, off[arc][1]))
        grams.pop(arc)
    passes_of = Counter(tracks.objects[tracks.object[np.argmax(tracks.arc == arc)]]
                        for arc in passes)
    strays_of = Counter(one.causes[0] for one in out)
    found = [one for one in out if not one.size < least
             or 2 * strays_of[one.causes[0]] < passes_of[one.causes[0]]]
    strays = [one.evidence['arc'] for one in found]
    return _renumbered(tracks.select(~np.isin(tracks.arc, strays))), found


def _elsewhere(tracks, bias_free=(), **_):
    """Reject passes at a different position, such as under another satellite's name.

    Also rejects parts of a pass; single rows are left to the fit. Returns the other tracks, and
    Findings on the rejected passes.
    """
    off = np.hypot(*robustly_off(tracks))
    own = tracks.orbit_sigma / np.maximum(tracks.speed, 1.0) * np.hypot(*tracks.ahead)
    known = ~np.isin(tracks.run['star'], list(bias_free))
    far = known & (off > np.maximum(_GROSS, _TIMES * np.median(off)) + 3.0 * own)
    out, found = np.zeros(len(tracks), bool), []
    for arc in np.unique(tracks.arc[~tracks.is_star]):
        rows = (tracks.arc == arc) & far
        if np.count_nonzero(rows) > _PART * np.count_nonzero(tracks.arc == arc):
            out |= rows
            found.append(_pass_finding(tracks, arc, np.sqrt(np.mean(off[rows]**2)), rows))
    # most rows must agree, of more than one pass
    if 2 * np.count_nonzero(out) > len(out) or len(np.unique(tracks.arc[~out])) < _PASSES:
        return tracks, []
    return _renumbered(tracks.select(~out)), found


def _pass_finding(tracks, arc, off, rows=None):
    rows = np.flatnonzero(tracks.arc == arc if rows is None else rows)
    return Finding('pass left out', float(off), unit='rad', causes=(
        tracks.objects[tracks.object[rows[0]]],), evidence={
            'arc': int(arc), 'rows': len(rows),
            'begin': float(np.min(np.asarray(tracks.run['time'], float)[rows]))})


def fit_without_faults(tracks, **options):
    """Fit tracks without passes that disagree with all others and satellites with a wrong orbit.

    Parameters
    ----------
    tracks : SatelliteTracks
    **options
        See `track_fit.fit_tracks`.

    Returns
    -------
    TrackFit
        ``left_out``, ``suspects`` and ``notes`` report which orbits are wrong, or may be.
    """
    out, suspects, freed = [], {}, ()
    tracks, notes = _elsewhere(tracks, **options)
    tracks, more = _without_strays(tracks, _GROSS, **options)
    notes += more
    while (kept := _without(tracks, out)).satellites:
        chances = fault_chances(kept, freed, **options)
        likely = _likely(chances)
        if '' in likely:
            break
        orbits = tuple(name for name in likely if name in kept.satellites)
        alone = len(orbits) == len(likely) == 1 and len(kept.satellites) > 1
        # fit each alone: together they may be degenerate
        found = {name: fit_tracks(kept, wrong=(name,), **options)[f'common {name}']
                 for name in likely if name not in orbits}
        notes.insert(0, Finding('orbit wrong' if alone else 'one of these wrong',
                                sum(chances[name] for name in likely), unit='', causes=orbits,
                                evidence=found))
        if alone:
            out.append(likely[0])
        elif orbits:
            suspects = {name: chances[name] for name in likely}
            break
        else:
            freed = likely
    if 2 * len(out) > len(tracks.objects):  # most must agree
        notes = [Finding('most orbits wrong', causes=tuple(out)),
                 *(one for one in notes if one.kind == 'pass left out')]
        out, suspects, freed = [], {}, ()
    tracks, more = _without_strays(_without(tracks, out), 0.0, wrong=freed + tuple(suspects),
                                   **options)
    notes += more
    fit = fit_tracks(tracks, wrong=freed + tuple(suspects), **options)
    if suspects:
        fit = replace(fit, model=_mean_model(
            {name: fit_tracks(tracks, wrong=(*freed, name), **options).model
             for name in suspects}, suspects))
    return replace(fit, left_out=tuple(out), suspects=suspects, notes=[*fit.notes, *notes])


def _likely(chances):
    """The fewest names with nearly all of the probability, the likeliest first."""
    names = sorted(chances, key=chances.get, reverse=True)
    sums = np.cumsum([chances[name] for name in names])
    return tuple(names[:1 + int(np.searchsorted(sums, SURE))])


def _mean_model(models, chances):
    """Mean over models with given probabilities; its covariance has their scatter."""
    weights = np.array([chances[name] for name in models]) / sum(chances.values())
    first, *_ = models = list(models.values())
    each = np.array([list(one.terms.values()) for one in models])
    mean = weights @ each
    covariance = sum(w * one.covariance for w, one in zip(weights, models)) + (
        (each - mean).T * weights) @ (each - mean)
    return replace(first, terms=dict(zip(first.terms, mean.tolist())), covariance=covariance)


def _without(tracks, names):
    """The tracks without some satellites."""
    bad = [tracks.objects.index(name) for name in names]
    return _renumbered(tracks.select(~np.isin(tracks.object, bad)))


def _renumbered(tracks):
    """The tracks with only the objects that have rows."""
    there, number = np.unique(tracks.object, return_inverse=True)
    return replace(tracks, objects=tuple(tracks.objects[i] for i in there), object=number)
