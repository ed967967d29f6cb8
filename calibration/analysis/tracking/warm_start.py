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

"""A night that begins: the past, and three to five stars.

A model of `telescope-mount season` has in its provenance what the terms have been from night to
night and how fast they drift within one (`history`). With these a tracked night begins, and from
then on a `Tracker` follows.

Four things may have happened since the last run: nothing, the zeros moved (an encoder that was
switched on), the lean too (a mount that was carried or set up anew), or more than that (a mirror
was taken out). Each is a distribution of tonight's terms; the stars say which, and what follows is
the mean of them, each as likely as it is. A wrong star among them is weighed too.
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
#: how likely each is before any star
CHANCES = (0.4, 0.3, 0.15, 0.15)
#: (times as far as runs have scattered so far, how likely) where it is more than the lean
FARTHER = ((1.0, 0.7), (3.0, 0.3))
#: 1 sigma of what is as it was: zeros, lean, others, rad
_STILL = (1.0 * ARCSEC, 0.5 * ARCSEC, 0.2 * ARCSEC)
#: zeros and lean that move do so as they have scattered from run to run, and by that at least, 1
#: sigma, rad
_LEAST_ZERO, _LEAST_LEAN = 20.0 * ARCSEC, 5.0 * ARCSEC
#: part of wrong stars, and what they miss by, rad
_WRONG, _WRONG_SIGMA = 0.02, 300.0 * ARCSEC
#: stars that a night begins with
STARS = 5
#: columns are first order about the terms: offsets are taken again about where they went
_ROUNDS = 2


@dataclass(frozen=True)
class NightStart:
    """What the first stars of a night say.

    Attributes
    ----------
    terms : dict of str to float
        rad.
    covariance : ndarray, shape (k, k)
        rad^2.
    chances : dict of str to float
        Of each of `HYPOTHESES`.
    """

    terms: dict
    covariance: np.ndarray
    chances: dict

    @property
    def likeliest(self):
        """Of `HYPOTHESES`."""
        return max(self.chances, key=self.chances.get)


def begin(past, columns, offsets, noise=None, *, mount=ALTAZ):
    """Tonight's terms from a few stars and the past.

    Parameters
    ----------
    past : Past
        Its names are the terms; `last` is what the night may be like.
    columns : ndarray, shape (n, 2, k)
        Of the stars, see `history.rows_of`.
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
        By the stars so far.
    """

    def __init__(self, model, past):
        self._model, self.start = model, None
        # deviations from the last night
        self._past = replace(past, mean=past.mean - past.last, last=np.zeros(len(past.last)))
        self._last = past.last
        self._columns, self._stars, self._noise = [], [], []

    @property
    def stars(self):
        """How many were taken."""
        return len(self._stars)

    @property
    def over(self):
        """Whether a `Tracker` goes on from here."""
        return self.stars >= STARS

    def take(self, az, el, x, y, context=None, sigma=None):
        """Take a star; what they all say by now, `NightStart`.

        Parameters
        ----------
        az, el, x, y, context, sigma
            As of `Tracker.star`; without `sigma` the noise is that of the nights before.
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
        """The `PointingModel` by now."""
        off = np.array(list(self.start.terms.values()))
        return self._with(self._last + off, self.start.covariance)

    def _with(self, terms, covariance):
        return replace(self._model, terms=dict(zip(self._past.names, map(float, terms))),
                       covariance=covariance)

    def document(self):
        """How likely each of `HYPOTHESES` is, JSON-ready."""
        return {'stars': self.stars, 'of': STARS,
                'chances': self.start.chances if self.start else None}

    def finding(self):
        """What has happened since the nights before."""
        start = self.start
        return Finding('night start', start.chances[start.likeliest], unit='',
                       causes=(start.likeliest,), evidence={'stars': self.stars})
