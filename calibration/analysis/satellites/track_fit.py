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

"""The fit of tracks: exact rotations, correlated noise, priors on the orbits."""

from dataclasses import dataclass, field, replace

import numpy as np

from pointing_model.model import PointingModel
from pointing_model.pointing_terms import stacked_design
from pointing_model.runs.satellite_tracks import STARS

from ...estimation.correlated_noise import Sequence
from ...estimation.noise_by_group import group_roots, likely_noises, white_sigmas
from ...estimation.prior_fit import MixedFit, PriorFit, gram_of
from ..sky_model import origin_of_errors, with_errors
from .track_columns import TrackColumns, track_columns

#: iterations of the exact rotations; each leaves about the square of the terms
_STEPS = 3
#: a coefficient is separated if correlation with the others leaves at least this share of its
#: information; from the second share on only if it is above `SIGNIFICANT` sigmas
_SEPARATED, HIDDEN, SIGNIFICANT = 0.5, 0.1, 2.0
#: error over the sky of a model from a dozen stars, relative to the noise of one: tracks with a
#: larger one do not determine the terms
_DOZEN = 0.54
#: range of elevations for the mean error over the sky, rad
_LOW, _HIGH = 0.35, 1.4


@dataclass
class TrackFit:
    """The fit of tracks.

    Attributes
    ----------
    tracks : SatelliteTracks
    columns : TrackColumns
    model : PointingModel
        With the terms and their covariance.
    values : ndarray, shape (k,)
        Values of all coefficients (not corrections of the last step).
    fit : MixedFit
        Fit of the last step.
    noises : list of (GroupNoise, float)
        Possible noise models and their probabilities.
    precision : ndarray, shape (k, k)
    prior_mean : ndarray, shape (k,)
        Prior inverse covariance and mean of the coefficients.
    weights : ndarray, shape (n,)
    before, after : ndarray, shape (2, n)
        Encoder - orbit on the sky, raw and after the fit, radians.
    left_out : tuple of str
        Satellites rejected for a wrong orbit.
    suspects : dict of str to float
        Probabilities of orbits and common errors, one of which is wrong.
    notes : list
        `Finding`.
    """

    tracks: object
    columns: TrackColumns
    model: PointingModel
    values: np.ndarray
    fit: MixedFit
    noises: list
    precision: np.ndarray
    prior_mean: np.ndarray
    weights: np.ndarray
    before: np.ndarray
    after: np.ndarray
    left_out: tuple = ()
    suspects: dict = field(default_factory=dict)
    notes: list = field(default_factory=list)

    def __getitem__(self, name):
        """Value and sigma of a coefficient."""
        at = self.columns.place(name)
        return float(self.values[at]), float(self.fit.sigma[at])

    def separated(self, name):
        """Whether a coefficient is separated from the others, which cannot absorb it."""
        value, sigma = self[name]
        left = self.own_part(name)
        return bool(left > _SEPARATED or left > HIDDEN and abs(value) > SIGNIFICANT * sigma)

    def own_part(self, name):
        """Share of the information on a coefficient that is independent of the others, 0 to 1."""
        if not self.fit.determined:
            return 0.0
        at = self.columns.place(name)
        return float((self.fit.alone[at] / self.fit.sigma[at]) ** 2)

    def sky_sigma(self):
        """Mean radial error over the sky from the covariance of the terms, RMS, rad."""
        mount = self.tracks.run.mount
        az, sine = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False),
                               np.linspace(np.sin(_LOW), np.sin(_HIGH), 8))
        first, second = mount.axes_of(az.ravel(), np.arcsin(sine.ravel()))
        rows = stacked_design(tuple(self.model.terms), first, second, mount)
        variance = np.einsum('kn,kj,jn->n', rows, self.model.covariance, rows)
        return float(np.sqrt(2.0 * np.mean(variance)))

    @property
    def determines(self):
        """Whether the tracks determine the terms over the sky as well as a dozen stars would."""
        white, process, _ = self.noise_of_rows()
        one = np.sqrt(2.0) * float(np.hypot(white, process).max())
        return self.fit.determined and self.sky_sigma() < _DOZEN * one

    def noise_of_rows(self):
        """The most likely noise: white and correlated part of each object, and correlation time.

        Returns
        -------
        white, process : ndarray, shape (objects,)
            1 sigma per axis, mean of both axes, rad.
        memory : float
            Correlation time, s; 0 if the noise is white.
        """
        noise, n = self.noises[0][0], len(self.tracks)
        white = np.array([np.sqrt(np.mean(white_sigmas(noise.root.reshape(2, n)[
            :, self.tracks.object == i].ravel()) ** 2)) for i in range(len(self.tracks.objects))])
        process, memory = np.zeros(len(white)), 0.0
        if noise.process is not None:
            remembers = ~np.array([name == STARS for name in self.tracks.objects])
            size = np.mean([one.variance for one in noise.process.memory])
            process[remembers], memory = np.sqrt(size), noise.process.memory[0].memory
        return white, process, memory


def with_origin(tracks):
    """Set whether errors of a German mount are of the mount or on the sky, from the stars.

    Parameters
    ----------
    tracks : SatelliteTracks

    Returns
    -------
    tracks : SatelliteTracks
    origin : sky_model.Origin or None
        None if the stars do not decide; then the tracks are unchanged.
    """
    stars = tracks.run.select(tracks.is_star)
    origin = origin_of_errors(stars) if len(stars) else None
    if origin is None or not origin.holds:
        return tracks, None
    return replace(tracks, run=with_errors(tracks.run, origin.holds)), origin


def fit_tracks(tracks, terms=None, held=None, *, clock_sigma=np.inf, bias_free=(), free=None,
               memory=True, wrong=()):
    """Fit terms, clock and orbits to tracks.

    Parameters
    ----------
    tracks : SatelliteTracks
    terms : sequence of str, optional
        By default the physical ones of the mount.
    held : PointingModel, optional
        Prior on the terms, with its covariance, except for the terms `free`.
    clock_sigma, bias_free
        See `track_columns`.
    free : sequence of str, optional
        Terms without a prior; by default the zeros of the axes.
    memory : bool
        Whether the noise of satellites may be correlated.
    wrong : collection of str
        See `track_columns`.

    Returns
    -------
    TrackFit

    Raises
    ------
    ValueError
        Fewer values than coefficients without a prior.
    """
    run, mount = tracks.run, tracks.run.mount
    if terms is None:
        terms = tuple(held.terms) if held is not None else mount.names.physical
    columns = track_columns(tracks, tuple(terms), clock_sigma, bias_free, wrong)
    precision, mean = _known(columns, held, mount.names.index if free is None else free)
    open_ones = int(np.count_nonzero(np.diag(precision) == 0.0))
    if 2 * len(tracks) <= open_ones:
        raise ValueError(f'{len(tracks)} rows are too few for {open_ones} coefficients; observe '
                         'more, or give a model (--model)')
    values = mean.copy()
    raw = np.array(run.offsets())
    time, cos_el = np.asarray(run['time'], float), np.cos(run['el'])
    remembers = [memory and name != STARS for name in tracks.objects]
    rows = np.flatnonzero(np.array(remembers)[tracks.object])
    for step in range(_STEPS):
        model = _model(columns, values, None, held, mount)
        left = (np.array(model.residuals(run)) - columns.orbits(values)).ravel()
        if step < 2:  # estimate the noise, and again when the terms are about right
            root, weights = group_roots(columns.columns, left, tracks.object, time, tracks.arc,
                                        cos_el, remembers)
            noises = likely_noises(columns.columns, left, precision, root, rows,
                                   Sequence(time[rows], tracks.arc[rows], cos_el[rows]))
        fit = MixedFit([PriorFit(gram_of(noise.whiten(columns.columns), noise.whiten(left)),
                                 noise.count, precision, mean - values) for noise, _ in noises],
                       [chance for _, chance in noises])
        values = values + fit.coefficients
    k = columns.terms
    model = _model(columns, values, fit.covariance[:k, :k], held, mount)
    return TrackFit(tracks, columns, model, values, fit, noises, precision, mean, weights, raw,
                    np.array(model.residuals(run)) - columns.orbits(values))


def _known(columns, held, free):
    """Prior precision and mean of the coefficients."""
    precision, mean = columns.precision(), np.zeros(len(columns.names))
    if held is None:
        return precision, mean
    names = columns.names[:columns.terms]
    known = [name for name in names if name in held.terms]
    mean[[columns.place(name) for name in known]] = [held.terms[name] for name in known]
    sure = [name for name in known if name not in free]
    if sure:
        of = [list(held.terms).index(name) for name in sure]
        at = [columns.place(name) for name in sure]
        covariance = held.covariance[np.ix_(of, of)]
        least = 1e-12 * max(float(np.diag(covariance).max()), 1e-24)
        precision[np.ix_(at, at)] = np.linalg.inv(covariance + least * np.eye(len(of)))
    return precision, mean


def _model(columns, values, covariance, held, mount):
    terms = dict(zip(columns.names[:columns.terms], values[:columns.terms].tolist()))
    more = {} if held is None else {'harmonics': held.harmonics, 'effects': held.effects,
                                    'geometry': held.geometry}
    return PointingModel(terms, covariance, mount=mount, **more)
