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


"""How well sessions explain the rows, with terms of their own: by BIC and stretches left out."""

from dataclasses import replace

import numpy as np

from calibration.estimation.correlated_noise import EIGEN, WhiteNoise
from calibration.estimation.group_columns import inverse_root
from calibration.estimation.linear_model import DISTINCT, LIVE, weighted_fit

from .base_terms import rotation_start

#: what is tried beside the zeros, together: where the camera sits, how the axis leans, how the
#: tube and the axes stand
_MOVING = (('CA',), ('AN', 'AW'), ('TF',), ('NPAE',))
#: stretches that each session is divided in, to leave one out; a shorter session is not compared
_PARTS, _LONG_ENOUGH = 3, 9


class SessionTrial:
    """Fits with terms of each session's own, all with the weights of one robust fit.

    A fit that may call rows outliers that another has explained would win by it.

    Parameters
    ----------
    obs : Observations
    base : Base
        Without own terms.
    session : ndarray of int, shape (n,)
        Of each row, where the sessions have the most freedom.
    """

    def __init__(self, obs, base, session):
        self._context, self._n, self._base = obs.context, len(obs), base
        self._order = np.arange(self._n) if obs.context.get('time') is None \
            else np.argsort(np.argsort(obs.context.get('time'), kind='stable'))
        self._left = rotation_start(obs, base)[1]
        zeros = replace(base, own=obs.run.mount.names.index)
        columns = zeros.columns(obs.context, session)
        fit = weighted_fit(columns, self._left, obs.inverse_sigma)
        given = 1.0 if obs.inverse_sigma is None else obs.inverse_sigma
        self._root = given * np.hstack([np.sqrt(fit.weights) / s for s in fit.scale])
        self._live = fit.weights > LIVE

    def best(self, session, own_terms):
        """Score of some sessions, and the own terms that reach it.

        Parameters
        ----------
        session : ndarray of int, shape (n,)
            Of each row.
        own_terms : sequence of str or None
            None: to be chosen.

        Returns
        -------
        tuple
            (BIC, RMS of stretches left out, own terms).
        """
        label = np.unique(session, return_inverse=True)[1]
        if label.max() == 0:
            return (*self._score((), label), own_terms or ())
        if own_terms is not None:
            return (*self._score(tuple(own_terms), label), tuple(own_terms))
        names = self._context.mount.names
        own = names.index
        groups = [g for g in (tuple(map(names.named, group)) for group in _MOVING)
                  if set(g) <= set(self._base.terms)]
        bic, left_out = self._score(own, label)
        while groups:
            tried = [(*self._score(own + group, label), group) for group in groups]
            tried = [one for one in tried if one[0] < bic and one[1] < left_out]
            if not tried:
                break
            bic, left_out, group = min(tried)
            own += group
            groups.remove(group)
        return bic, left_out, own

    def _score(self, own, label):
        """k ln n - 2 ln L, with noise of its own for each axis, and the RMS of rows left out."""
        columns = replace(self._base, own=own).columns(self._context, label)
        live = int(self._live.sum())
        residual, count = self._fit(columns, self._root)
        if 2 * live < count + 4:
            return np.inf, np.inf
        rss = np.square(residual * self._root).reshape(2, -1).sum(axis=1) + 1e-30
        bic = live * float(np.log(rss / live).sum()) + count * np.log(live)
        place, size = np.empty(self._n, int), np.empty(self._n, int)
        for session in range(label.max() + 1):
            rows = np.flatnonzero(label == session)
            place[rows[np.argsort(self._order[rows])]] = np.arange(len(rows))
            size[rows] = len(rows)
        long_enough = self._live & (size >= _LONG_ENOUGH)
        total = 0.0
        for part in range(_PARTS):
            out = np.tile(place * _PARTS // size == part, 2)
            left, _ = self._fit(columns, np.where(out, 0.0, self._root))
            total += np.square((left * self._root)[out & np.tile(long_enough, 2)]).sum()
        return bic, np.sqrt(total / max(long_enough.sum(), 1))

    def _fit(self, columns, root):
        """What is left of all rows, shape (2n,), and how many coefficients were determined."""
        common, b, noise = columns.common, self._left, WhiteNoise(root)
        groups = columns.whitened(noise).orthonormal_groups()
        white, left = noise.whiten(common), groups.off(noise.whiten(b))
        length = np.sqrt(np.square(white).sum(axis=1))
        white = groups.off(white)
        white[np.sqrt(np.square(white).sum(axis=1)) < DISTINCT * length] = 0.0
        scale = np.where(white.any(axis=1), length, 1.0)[:, None]
        p = np.linalg.lstsq((white / scale).T, left, rcond=EIGEN)[0] / scale[:, 0]
        out = b - p @ common
        if columns.groups:
            # what the rows of a session hardly determine is taken as zero
            known = inverse_root(columns.own_normal(root**2), DISTINCT**2)
            out -= columns.spread(columns.share(out[None], root**2, known))[0]
        return out, len(groups) + np.count_nonzero(white.any(axis=1))
