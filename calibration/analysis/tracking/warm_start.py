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

"""The beginning of a night: terms from earlier nights and three to five stars.

A model of `telescope-mount season` has in its provenance the distribution of the terms from night
to night and their drift rates within one (`history`). A tracked night begins with these, and then
continues with a `Tracker`.

Four things may have happened since the last run: nothing, the zeros moved (an encoder was switched
on), the tilt too (the mount was carried or set up anew), or more (a mirror was taken out). Each is
a prior distribution of tonight's terms. The first stars give their posterior probabilities, and the
start is the mixture of them. A wrong star among these is allowed for.
"""

from dataclasses import dataclass, replace

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.mounts import ALTAZ
from pointing_model.pointing_terms import design

from ...estimation.gaussian_sum import GaussianSum
from ..finding import Finding

AS_IT_WAS, ZEROS, LEAN, REFIT = HYPOTHESES = (
    'all as it was', 'only the zeros moved', 'the tilt too', 'more than that')
#: prior probability of each
CHANCES = (0.4, 0.3, 0.15, 0.15)
#: for `REFIT`: (factor of the scatter of earlier runs, probability)
FARTHER = ((1.0, 0.7), (3.0, 0.3))
#: 1 sigma of unchanged zeros, tilt and other terms, rad
_STILL = (1.0 * ARCSEC, 0.5 * ARCSEC, 0.2 * ARCSEC)
#: smallest 1 sigma of a change of zeros and tilt, rad; otherwise it is their scatter between runs
_LEAST_ZERO, _LEAST_LEAN = 20.0 * ARCSEC, 5.0 * ARCSEC
#: share of wrong stars, and 1 sigma of their error, rad
_WRONG, _WRONG_SIGMA = 0.02, 300.0 * ARCSEC
#: number of stars used
STARS = 5
#: iterations: columns are first order, so offsets are linearised again at the new terms
_ROUNDS = 2


@dataclass(frozen=True)
class NightStart:
    """Terms after the first stars of a night.

    Attributes
    ----------
    terms : dict of str to float
        rad.
    covariance : ndarray, shape (k, k)
        rad^2.
    chances : dict of str to float
        Probability of each of `HYPOTHESES`.
    """

    terms: dict
    covariance: np.ndarray
    chances: dict

    @property
    def likeliest(self):
        """The most likely of `HYPOTHESES`."""
        return max(self.chances, key=self.chances.get)


def begin(past, columns, offsets, noise=None, *, mount=ALTAZ):
    """Tonight's terms from a few stars and earlier nights.

    Parameters
    ----------
    past : Past
        Defines the terms; `last` is the starting point of all hypotheses but `REFIT`.
    columns : ndarray, shape (n, 2, k)
        Design columns of the stars, see `history.rows_of`.
    offsets : ndarray, shape (n, 2)
        rad.
    noise : ndarray, shape (n, 2), optional
        1 sigma of each, rad; by default that of `past`.
    mount : Mount

    Returns
    -------
    NightStart
    """
    names = past.names
    scatter = np.sqrt(np.diag(past.covariance))
    index = [names.index(name) for name in mount.names.index if name in names]
    lean = [names.index(mount.names.named(name)) for name in ('AN', 'AW')
            if mount.names.named(name) in names]
    still = np.full(len(names), _STILL[2])
    still[index], still[lean] = _STILL[:2]
    zeros, leans = np.zeros((2, len(names)))
    zeros[index] = scatter[index].max(initial=_LEAST_ZERO)
    leans[lean] = scatter[lean].max(initial=_LEAST_LEAN)
    as_it_was = past.last_covariance + np.diag(still**2)
    moved = as_it_was + np.diag(zeros**2)
    wide = [past.covariance * scale**2 + np.diag(still**2) for scale, _ in FARTHER]
    shares = [*CHANCES[:3], *(CHANCES[3] * share for _, share in FARTHER)]
    start = GaussianSum(
        [past.last] * 3 + [past.mean] * len(wide),
        [as_it_was, moved, moved + np.diag(leans**2), *wide],
        np.zeros((len(shares), len(names), len(names))), shares, outliers=_WRONG,
        outlier_sigma=_WRONG_SIGMA, depth=len(offsets) + 1, most=64)
    if noise is None:
        noise = np.full(offsets.shape, past.noise)
    for one in zip(columns, offsets, noise):
        start.observe(*one)
    mean, covariance = start.estimate()
    weights = start.rate_weights()
    return NightStart(dict(zip(names, mean.tolist())), covariance,
                 dict(zip(HYPOTHESES, (*weights[:3].tolist(), float(weights[3:].sum())))))


class WarmStart:
    """The model after each of the first stars.

    Parameters
    ----------
    model : PointingModel
        With the terms of `past`.
    past : Past

    Attributes
    ----------
    start : NightStart or None
        From the stars so far.
    """

    def __init__(self, model, past):
        self._model, self.start = model, None
        # deviations from the last night
        self._past = replace(past, mean=past.mean - past.last, last=np.zeros(len(past.last)))
        self._last = past.last
        self._columns, self._stars, self._noise = [], [], []

    @property
    def stars(self):
        """Number of stars taken."""
        return len(self._stars)

    @property
    def over(self):
        """Whether it is complete, and a `Tracker` takes over."""
        return self.stars >= STARS

    def take(self, az, el, x, y, context=None, sigma=None):
        """Take a star, and return the `NightStart` from all stars so far.

        Parameters
        ----------
        az, el, x, y, context, sigma
            See `Tracker.star`; without `sigma` the noise is that of earlier nights.
        """
        self._columns.append(np.stack(design(self._past.names, np.atleast_1d(az),
                                             np.atleast_1d(el), self._model.mount), axis=1)[0])
        self._stars.append((az, el, np.array([x, y]), context))
        self._noise.append((self._past.noise,) * 2 if sigma is None else sigma)
        columns, off = np.array(self._columns), np.zeros(len(self._last))
        for _ in range(_ROUNDS):
            base = self._with(self._last + off, self._past.covariance)
            offsets = np.array([
                offset - base.offsets(own_az, own_el, own)
                for own_az, own_el, offset, own in self._stars]) + columns @ off
            self.start = begin(self._past, columns, offsets, np.array(self._noise),
                               mount=self._model.mount)
            off = np.array(list(self.start.terms.values()))
        return self.start

    def model(self):
        """The current `PointingModel`."""
        off = np.array(list(self.start.terms.values()))
        return self._with(self._last + off, self.start.covariance)

    def _with(self, terms, covariance):
        return replace(self._model, terms=dict(zip(self._past.names, map(float, terms))),
                       covariance=covariance)

    def document(self):
        """Probabilities of `HYPOTHESES`, JSON-ready."""
        return {'stars': self.stars, 'of': STARS,
                'chances': self.start.chances if self.start else None}

    def finding(self):
        """Finding: what has changed since earlier nights."""
        start = self.start
        return Finding('night start', start.chances[start.likeliest], unit='',
                       causes=(start.likeliest,), evidence={'stars': self.stars})
