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

"""A satellite whose orbit is wrong, noticed by the others, and left out by name.

Each satellite in turn may be off along its track, constantly or as it goes, by any size: how likely
the rows are then, whatever mount, clock and orbits are, is compared with that of no orbit being
wrong. Half of the prior is that none is. One that takes nearly all of the chance is left out, and
the others are looked at again; where several share it, they are named as such, and the fit is the
mean over them.
"""

from dataclasses import replace

import numpy as np

from msg_tools.units import ARCSEC

from ...estimation.prior_fit import PriorFit, gram_of
from ..finding import Finding
from .track_fit import fit_tracks

#: chance from which on an orbit is wrong, and one that is worth a name beside others
SURE, POSSIBLE = 0.98, 0.02
#: RMS along the track that a wrong orbit may have
_SIZES = tuple(size * ARCSEC for size in (5.0, 10.0, 20.0, 40.0, 80.0, 160.0, 320.0))
#: satellites that must be left
_LEAST = 2


def fault_chances(tracks, **options):
    """How likely it is that the orbit of each satellite is wrong.

    Parameters
    ----------
    tracks : SatelliteTracks
    **options
        As of `track_fit.fit_tracks`.

    Returns
    -------
    dict of str to float
        By satellite, '' for none; they sum to 1.
    """
    names = tracks.satellites
    # the noise is that of tracks of which each may be wrong: a fault is none of it
    full = fit_tracks(tracks, drifts=names, **options)
    columns, noise = full.columns, full.noises[0][0]
    n = len(tracks)
    values = full.values.copy()
    values[:columns.terms] = 0.0
    left = (full.after + (values @ columns.columns).reshape(2, n)).ravel()
    gram = gram_of(noise.whiten(columns.columns), noise.whiten(left))
    plain = np.ones(len(columns.names), bool)
    for part, _ in columns.drifts.values():
        plain[part] = False
    prior, mean = full.precision, full.prior_mean - full.values
    mean[columns.terms:] = 0.0
    logs = {'': _evidence(gram, noise.count, prior, mean, plain, None, 0.0) + np.log(0.5)}
    for name in names:
        part, covariance = columns.drifts[name]
        kept = plain.copy()
        kept[part] = True
        inverse, log_det = np.linalg.inv(covariance), np.linalg.slogdet(covariance)[1]
        m = len(covariance)
        tried = [_evidence(gram, noise.count, prior, mean, kept, (part, inverse / size**2),
                           log_det + 2.0 * m * np.log(size)) for size in _SIZES]
        logs[name] = float(np.logaddexp.reduce(tried)) + np.log(
            0.5 / len(names) / len(_SIZES))
    most = max(logs.values())
    chance = {name: float(np.exp(value - most)) for name, value in logs.items()}
    total = sum(chance.values())
    return {name: value / total for name, value in chance.items()}


def _evidence(gram, count, prior, mean, kept, drift, log_prior):
    precision = prior.copy()
    if drift is not None:
        part, inverse = drift
        precision[part, part] = inverse
    rows = np.append(np.flatnonzero(kept), len(kept))
    own = precision[np.ix_(rows[:-1], rows[:-1])]
    fit = PriorFit(gram[np.ix_(rows, rows)], count, own, mean[rows[:-1]])
    return -0.5 * (fit.square + fit.log_det + log_prior)


def fit_without_faults(tracks, **options):
    """Fit tracks, without satellites whose orbit is wrong.

    Parameters
    ----------
    tracks : SatelliteTracks
    **options
        As of `track_fit.fit_tracks`.

    Returns
    -------
    TrackFit
        ``left_out``, ``suspects`` and ``notes`` say which orbits are wrong, or may be.
    """
    out, suspects, notes = [], {}, []
    while True:
        kept = _without(tracks, out)
        if len(kept.satellites) < _LEAST:
            break
        chances = fault_chances(kept, **options)
        worst = max((name for name in chances if name), key=chances.get)
        if chances[worst] > SURE:
            out.append(worst)
            notes.append(Finding('orbit wrong', chances[worst], unit='', causes=(worst,)))
            continue
        if chances[''] < 1.0 - SURE:
            suspects = {name: chance for name, chance in chances.items()
                        if name and chance > POSSIBLE}
            notes.append(Finding('one orbit of these wrong', 1.0 - chances[''], unit='',
                                 causes=tuple(sorted(suspects))))
        break
    fit = fit_tracks(_without(tracks, out), drifts=tuple(suspects), **options)
    return replace(fit, left_out=tuple(out), suspects=suspects, notes=[*fit.notes, *notes])


def _without(tracks, names):
    """The tracks without some satellites; the others keep their numbers."""
    if not names:
        return tracks
    bad = [tracks.objects.index(name) for name in names]
    out = tracks.select(~np.isin(tracks.object, bad))
    return _renumbered(out)


def _renumbered(tracks):
    """With the objects that have rows alone."""
    there, number = np.unique(tracks.object, return_inverse=True)
    return replace(tracks, objects=tuple(tracks.objects[i] for i in there), object=number)
