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

"""Analysis of a season: causes, random walks, smoothed terms, and a prediction for a night."""

from dataclasses import dataclass, replace

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.model import PointingModel

from ..finding import Finding, far_outside
from ..tracking.history import PAST, RATES, past_of_runs, rates_of_nights
from .season_causes import SEASON_ALPHA, candidates, choose_causes
from .season_kalman import (
    NightlyTerms,
    SeasonPath,
    TermVariation,
    forecast,
    season_path,
)
from .season_nights import Nights, date_of, days, table_rows, without_odd_nights

#: fewest stars with separate times in a night used for drift rates
TELLING = 12
_DAY = 86400.0
_YEAR = 365.25


@dataclass(frozen=True)
class SeasonAnalysis:
    """Result of `analyse_season`.

    Attributes
    ----------
    season : Nights
    causes : list of SeasonChoice
    variation : TermVariation
    path : SeasonPath
    tonight : float
        UTC, s.
    mean : ndarray, shape (k,)
        Terms predicted for tonight, rad.
    covariance : ndarray, shape (k, k)
        rad^2.
    notes : list of Finding
    """

    season: Nights
    causes: list
    variation: TermVariation
    path: SeasonPath
    tonight: float
    mean: np.ndarray
    covariance: np.ndarray
    notes: list

    def coefficients(self):
        """Coefficients of each cause: values and 1 sigma, rad, shapes (terms, m)."""
        out, at, found = [], len(self.season.names), self.path.estimate
        sigma = np.sqrt(np.diag(found.covariance))
        for one in self.causes:
            shape = len(one.cause.terms), one.cause.shape.shape[1]
            part = slice(at, at + shape[0] * shape[1])
            out.append((found.coefficients[part].reshape(shape),
                        sigma[part].reshape(shape)))
            at = part.stop
        return out

    def findings(self):
        """One Finding for each cause."""
        return [_finding(self.season, found, *own)
                for found, own in zip(self.causes, self.coefficients())]

    def model(self):
        """`PointingModel` for tonight: the predicted terms with their covariance.

        Its provenance has the priors for a tracked night, see `tracking.warm_start`.
        """
        earlier = {}
        if all(night.run is not None for night in self.season.nights):
            past, rates = past_and_rates(self.season, self.mean)
            noise = past.noise / ARCSEC
            earlier = {'fitted_rms_arcsec': {'x': noise, 'y': noise}, PAST: past.document(),
                       **({RATES: rates.document()} if rates else {})}
        return PointingModel(
            dict(zip(self.season.names, self.mean.tolist())), self.covariance,
            mount=self.season.mount, provenance={
                'source': f'{len(self.season.nights)} nights until '
                          f'{date_of(self.season.nights[-1].time)}',
                'for': date_of(self.tonight), **earlier})

    def document(self):
        """The full result for JSON, with findings; angles in arcsec."""
        names, k = self.season.names, len(self.season.names)
        sigma = np.sqrt(np.diag(self.covariance))
        own = np.sqrt(np.maximum(np.array([np.diag(c) for c in self.path.covariances]), 0.0))
        nights = table_rows(self.season)
        for i, night in enumerate(nights):
            off = self.path.innovations[i]
            night['in_hindsight_arcsec'] = dict(zip(
                names, (self.path.levels[i] / ARCSEC).tolist()))
            night['in_hindsight_sigma_arcsec'] = dict(zip(names, (own[i] / ARCSEC).tolist()))
            night['off_foretold_sigmas'] = {
                name: None if np.isnan(v) else float(v) for name, v in zip(names, off)}
        return {
            'mount': self.season.mount.kind, 'terms': list(names), 'nights': nights,
            'causes': [{
                'kind': found.cause.kind, 'what': found.cause.text, 'p': found.p,
                'terms': {names[term]: {'arcsec': (value / ARCSEC).tolist(),
                                        'sigma_arcsec': (spread / ARCSEC).tolist()}
                          for term, value, spread in zip(found.cause.terms, *values)},
                'unit': found.cause.unit, 'sentence': finding}
                for found, values, finding in zip(self.causes, self.coefficients(),
                                                   self.findings())],
            'wander': {name: {'walk_arcsec_per_root_day': float(self.variation.walk[i]) / ARCSEC,
                              'night_arcsec': float(self.variation.scatter[i]) / ARCSEC}
                       for i, name in enumerate(names)},
            'tonight': {
                'time': date_of(self.tonight),
                'terms_arcsec': dict(zip(names, (self.mean / ARCSEC).tolist())),
                'sigma_arcsec': dict(zip(names, (sigma / ARCSEC).tolist())),
                'covariance_arcsec2': (self.covariance / ARCSEC**2).reshape(k, k).tolist()},
            'notes': [*self.season.notes, *self.notes]}


def analyse_season(season, *, declared=(), tonight=None, causes=None, alpha=SEASON_ALPHA):
    """Find causes of changes in the terms of a season, and predict a night.

    Parameters
    ----------
    season : Nights
    declared : sequence of (float, str)
        Maintenance of the mount: UTC (s), and what was done.
    tonight : float, optional
        UTC, s; by default a day after the last night.
    causes : dict of str to float, optional
        Known columns of that night.
    alpha : float
        Threshold of the p-value of a cause, see `SEASON_ALPHA`.

    Returns
    -------
    SeasonAnalysis

    Raises
    ------
    ValueError
        `tonight` is before the last night, or no night has a column in `causes`.
    """
    season, odd = without_odd_nights(season)
    nights, k = season.nights, len(season.names)
    tonight = nights[-1].time + _DAY if tonight is None else tonight
    if tonight < nights[-1].time:
        raise ValueError(f'{date_of(tonight)} is before the last night, of '
                         f'{date_of(nights[-1].time)}: ask for a later one')
    for name in causes or {}:
        if not any(name in night.causes for night in nights):
            raise ValueError(f'no night has a column {name}')
    causes = {name: value for name, value in (causes or {}).items() if np.isfinite(value)}
    day = days(nights)
    terms = NightlyTerms(day, np.array([night.values for night in nights]),
                np.array([night.covariance for night in nights]),
                np.zeros((len(nights), k, 0)))
    notes = odd
    steps = [((when - nights[0].time) / _DAY, text) for when, text in declared]
    for at, text in steps:
        if not day[0] < at <= day[-1]:
            notes.append(Finding('step outside the season', evidence={'step': text}))
    found, variation = choose_causes(terms, candidates(season, day, steps), alpha)
    path = season_path(terms.with_columns([one.cause.columns(k) for one in found]), variation)
    at = (tonight - nights[0].time) / _DAY
    drivers = {entry.cause.text: entry.cause for entry in found if entry.cause.kind == 'column'}
    unknown = sorted(set(drivers) - set(causes))
    notes += [far for name, cause in drivers.items() if name in causes
              for far in far_outside(name, causes[name], cause.shape
                                     + causes[name] - cause.tonight(0.0, causes)[0])]
    if unknown:
        notes.append(Finding('cause unknown tonight', causes=tuple(unknown)))
    columns = [entry.cause.columns_of(at, causes, k) for entry in found]
    mean, covariance = forecast(path, variation, at - day[-1],
                                np.concatenate([np.zeros((k, 0)), *columns], axis=1))
    out = SeasonAnalysis(season, found, variation, path, tonight, mean, covariance, notes)
    return replace(out, covariance=covariance + _of_unknown(out, unknown))


def _of_unknown(analysis, unknown):
    """Covariance of the terms due to causes unknown tonight, from their scatter between nights."""
    k = len(analysis.season.names)
    out = np.zeros((k, k))
    for found, (values, _) in zip(analysis.causes, analysis.coefficients()):
        if found.cause.kind == 'column' and found.cause.text in unknown:
            shape = found.cause.shape[:, 0]
            moved = np.zeros(k)
            moved[list(found.cause.terms)] = values[:, 0] * np.std(shape[shape != 0.0])
            out += np.outer(moved, moved)
    return out


def past_and_rates(season, mean):
    """Priors from earlier nights: distribution of the terms, and drift rates within a night.

    Parameters
    ----------
    season : Nights
    mean : ndarray, shape (k,)
        Predicted terms, rad.

    Returns
    -------
    past : tracking.history.Past
        Scatter from night to night from `past_of_runs`.
    rates : tracking.history.Rates or None
        None if no night has stars with times.
    """
    past = replace(past_of_runs([night.run for night in season.nights], season.names), mean=mean)
    model = PointingModel(dict(zip(season.names, mean.tolist())), past.covariance,
                          mount=season.mount)
    timed = [(model, run) for run in (_timed(night.run) for night in season.nights)
            if len(run) >= TELLING]
    return past, rates_of_nights(timed, noise=past.noise) if timed else None


def _timed(run):
    """Rows with distinct times, in order."""
    time, first = np.unique(run.get('time'), return_index=True)
    return run.select(first[np.isfinite(time)])


_KINDS = {'step': 'season step', 'declared': 'season declared', 'year': 'season year',
          'trend': 'season trend', 'column': 'season column'}


def _finding(season, found, value, sigma):
    cause, names = found.cause, season.names
    evidence = {'cause': cause.text, 'terms': [
        (names[term], (v / ARCSEC).tolist(), (s / ARCSEC).tolist())
        for term, v, s in zip(cause.terms, value, sigma)]}
    if cause.kind in ('step', 'declared'):
        begin, end = (night.time for night in season.nights[cause.first - 1:cause.first + 1])
        evidence['between'] = date_of(begin, end), date_of(end, begin)
    if cause.kind == 'year':
        v = value[0]
        turn = np.arctan2(v[1], v[0]) / (2.0 * np.pi) * _YEAR
        evidence['peak'] = season.nights[0].time + (turn % _YEAR) * _DAY
    return Finding(_KINDS[cause.kind], causes=(cause.text,), evidence=evidence)
