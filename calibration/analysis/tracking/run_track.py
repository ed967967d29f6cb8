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

"""A measured run tracked star by star: the prediction error of each star."""

from dataclasses import dataclass

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.context import Context
from pointing_model.model import PointingModel
from pointing_model.rms import rms
from pointing_model.zero import PowerOnZero

from ...rows import floored
from ..diagnosis.mistaken_columns import check_columns
from ..term_fit import fit_terms
from .smoother import SmoothedNight
from .tracked_night import TrackedNight, difference_of, lean_of
from .tracker import model_of_fit

#: fewest stars to which the model of the evening is fitted
FEWEST = 12
#: standard deviations of von Neumann's ratio that are chance (1 %)
_BY_CHANCE = 2.33


@dataclass(frozen=True)
class TrackedRun:
    """A run that was tracked.

    Attributes
    ----------
    model : PointingModel
        After the last star.
    rows : ndarray of int, shape (t,)
        Indices in the run of the stars tracked.
    time : ndarray, shape (t,)
        UTC, s.
    evening, live : ndarray, shape (t, 2)
        Prediction error of each star, x and y on the sky, with the model of the evening and with
        the tracked model; rad.
    sigma : ndarray, shape (t, 2)
        1 sigma expected by the tracked model, with the noise of the star, rad.
    smoothed : SmoothedNight
    document : dict
        See `TrackedNight.document`.
    fitted : int
        Number of rows to which the model of the evening was fitted; 0: it was given.
    notes : list of str or Finding
        Notes of the file reader, and doubts about the columns.
    """

    model: PointingModel
    rows: np.ndarray
    time: np.ndarray
    evening: np.ndarray
    live: np.ndarray
    sigma: np.ndarray
    smoothed: SmoothedNight
    document: dict
    fitted: int
    notes: list

    def summary(self):
        """Summary for JSON, with findings; arcsec, radial RMS of the prediction errors."""
        notes = [*self.notes, *self.document['notes']]
        return {**self.document, 'notes': notes, 'fitted_rows': self.fitted, 'missed_rms_arcsec': {
            'model of the evening': rms(*self.evening.T) / ARCSEC,
            'tracked': rms(*self.live.T) / ARCSEC,
            'expected': rms(*self.sigma.T) / ARCSEC,
            'tracked, middle': float(np.median(np.hypot(*self.live.T))) / ARCSEC,
            'model of the evening, middle': float(np.median(np.hypot(*self.evening.T))) / ARCSEC},
            'hindsight': self.smoothed.document()}


def track_run(run, model=None, first=None, names=None, progress=None):
    """Track a run.

    Parameters
    ----------
    run : PointingRun
        With the column ``time``; in any order.
    model : PointingModel, optional
        Model of the evening; by default fitted to the first rows.
    first : int, optional
        Number of these rows; by default a third of the run, at least `FEWEST`.
    names : sequence of str, optional
        Terms to fit; by default the physical ones.
    progress : callable, optional
        Called with (text, done, total).

    Returns
    -------
    TrackedRun

    Raises
    ------
    ValueError
        No times, too few rows, a model of another mount, or mistaken columns.
    """
    notes = [*run.meta.get('notes', ()), *check_columns(run).doubts(run.mount.names)]
    if 'time' not in run or not np.isfinite(run['time']).any():
        raise ValueError('the run has no time: a model is followed from star to star')
    order = np.flatnonzero(np.isfinite(run['time']))
    order = order[np.argsort(run['time'][order], kind='stable')]
    run = _complete(run.select(order))
    noise, fitted, held = None, 0, None
    if model is None:
        fitted = max(FEWEST, len(run) // 3) if first is None else first
        if len(run) < fitted + 3:
            raise ValueError(f'{len(run)} rows with a time; to fit {fitted} and follow the rest '
                             'takes three more')
        held = run.select(np.arange(fitted))
        fit = fit_terms(held, names)
        model, noise = model_of_fit(fit), _noise_of_stars(fit)
    elif not model.mount.agrees(run.mount):
        raise ValueError('the model is of another mount than the run')
    begun = run['time'][max(fitted - 1, 0)] if fitted else run['time'][0] - 1.0
    numbers = run['run'][fitted - 1] if fitted else None
    started = run['encoder_start'][fitted - 1] if fitted and 'encoder_start' in run else None
    night = TrackedNight(
        model, PowerOnZero(0.0, 0.0, run=None if numbers is None else float(numbers),
                           started=started), int(np.rint(begun * 1e9)), noise,
        held and difference_of(held), held and lean_of(held))
    night.keep()
    rows, time, evening, live, sigma = [], [], [], [], []
    for i in range(fitted, len(run)):
        one = run.select([i])
        if progress:
            progress('following the mount', i, len(run))
        for update in night.take(one):
            if update.what == 'star' and update.taken:
                rows.append(int(order[i]))
                time.append(float(one['time'][0]))
                live.append(update.innovation)
                sigma.append(np.sqrt(np.diag(update.covariance)))
                context = Context.from_run(one) if model.effects else None
                base = model.offsets(one['az'], one['el'], context)
                evening.append([float(o[0] - b[0]) for o, b in zip(one.offsets(), base)])
    if len(rows) < 3:
        raise ValueError(f'{len(rows)} stars to follow; three at least')
    if progress:
        progress('smoothing', len(run), len(run))
    return TrackedRun(
        night.model(int(np.rint(run['time'][-1] * 1e9))), np.array(rows), np.array(time),
        np.array(evening), np.array(live), np.array(sigma), night.smoothed(), night.document(),
        fitted, notes)


def _noise_of_stars(fit):
    """1 sigma of a star along x and y, rad: without the drift that a fit leaves in its residuals.

    Where neighbours in time are alike by more than chance (von Neumann's ratio), it is the scatter
    of their differences.
    """
    left = np.array([fit.residual_x, fit.residual_y])[:, fit.weights > 0.0]
    share = np.mean(np.square(np.diff(left)), axis=1) / (2.0 * np.mean(np.square(left), axis=1))
    share[share > 1.0 - _BY_CHANCE / np.sqrt(left.shape[1])] = 1.0
    return tuple((fit.scatter * np.sqrt(share)).tolist())


def _complete(run):
    """Add columns that a file may lack but a log always has."""
    n = len(run)
    columns = dict(run.columns)
    columns.setdefault('run', np.zeros(n))
    star = columns.get('star')
    if star is None or np.asarray(star).dtype.kind not in 'fiu':
        columns['star'] = np.arange(1.0, n + 1.0)
    for name in ('sigma_x', 'sigma_y'):  # raise sigmas far below the others, as in a fit
        if name in columns:
            known = np.isfinite(columns[name])
            columns[name] = np.array(columns[name], float)
            columns[name][known] = floored(columns[name][known])
    return type(run)(columns, run.meta)
