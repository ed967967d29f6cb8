"""Where the terms are by now: a filter over what may have happened to a mount.

A Gaussian sum: of each story (nothing happened, an axis jumped before that star, that star was a
wrong one) and of each pair of rates at which the terms may wander a Kalman filter, all of them at
once, each with its weight by Bayes' rule. Nothing is decided that the observations do not decide;
old differences between stories are averaged.

Linear in small terms: Bar-Shalom, Li and Kirubarajan 2001, Estimation with applications to
tracking and navigation, chapters 5 and 11.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Event:
    """That something has happened before an observation.

    Attributes
    ----------
    number : int
        Of the observation, from 0.
    cause : int
        Number of the `Jump`; -1: the observation itself is a wrong star.
    """

    number: int
    cause: int


@dataclass(frozen=True)
class Jump:
    """Terms that may jump together.

    Attributes
    ----------
    name : str
        What has moved.
    shape : ndarray, shape (n,)
        Of the terms, for a jump of 1.
    sigma : float
        1 sigma of its size, rad.
    per_hour : float
        How often.
    """

    name: str
    shape: np.ndarray
    sigma: float
    per_hour: float


class Bank:
    """The stories and rates, from one observation to the next.

    Parameters
    ----------
    mean : ndarray, shape (n,)
        Terms to begin with, rad.
    covariance : ndarray, shape (n, n)
        Of them, rad^2.
    rates : ndarray, shape (r, n)
        How far each term wanders by each hypothesis, rad in the root of an hour.
    weights : ndarray, shape (r,), optional
        How likely each is; all alike by default.
    jumps : sequence of Jump
    wrong : float
        Part of the observations that are of a wrong star.
    wrong_sigma : float
        1 sigma of what those miss by, rad.
    memory_h : ndarray, shape (n,), optional
        After which a term has gone back to `mean` by a factor e; inf: never.
    most : int
        Stories that are kept.
    depth : int
        Observations after which stories that differ only before are one.
    """

    def __init__(self, mean, covariance, rates, weights=None, *, jumps=(), wrong=0.01,
                 wrong_sigma=1e-3, memory_h=None, most=16, depth=4):
        rates = np.atleast_2d(np.asarray(rates, dtype=float))
        count, n = rates.shape
        self._rates, self._jumps = rates, tuple(jumps)
        self._wrong, self._wrong_sigma = wrong, wrong_sigma
        self._most, self._depth = most, depth
        self._home = np.asarray(mean, dtype=float)
        self._memory = np.full(n, np.inf) if memory_h is None else np.asarray(memory_h, float)
        self.means = np.tile(self._home, (1, count, 1))
        self.covariances = np.tile(np.asarray(covariance, dtype=float), (1, count, 1, 1))
        start = np.full(count, 1.0 / count) if weights is None else np.asarray(weights, float)
        with np.errstate(divide='ignore'):
            self.log_weights = np.log(start / start.sum())[None, :]
        self.stories = [()]
        self.count = 0
        self._since = 0.0  # h, since the last observation

    # --- what it says -------------------------------------------------------------------------

    @property
    def weights(self):
        """Of each story and pair of rates, shape (b, r)."""
        return np.exp(self.log_weights)

    def estimate(self):
        """Mean and covariance of the terms, shapes (n,) and (n, n)."""
        weights = self.weights
        mean = np.einsum('br,brn->n', weights, self.means)
        off = self.means - mean
        return mean, (np.einsum('br,brij->ij', weights, self.covariances)
                      + np.einsum('br,bri,brj->ij', weights, off, off))

    def predicted(self, columns):
        """Mean and covariance of what an observation would show, shapes (m,) and (m, m)."""
        mean, covariance = self.estimate()
        return columns @ mean, columns @ covariance @ columns.T

    def chance(self, number):
        """How likely each jump before observation `number`, and that it was a wrong star.

        Returns
        -------
        ndarray, shape (jumps + 1,)
            The last: a wrong star.
        """
        out = np.zeros(len(self._jumps) + 1)
        for story, weight in zip(self.stories, self.weights.sum(axis=1)):
            for event in story:
                if event.number == number:
                    out[event.cause] += weight
        return out

    def rate_weights(self):
        """How likely each hypothesis of the rates is by now, shape (r,)."""
        return self.weights.sum(axis=0)

    # --- what it is told ----------------------------------------------------------------------

    def wait(self, hours):
        """Time passes, in which terms wander.

        Parameters
        ----------
        hours : float
            Not negative.
        """
        walk = np.square(self._rates)
        kept = np.exp(-hours / self._memory)
        # of a term that goes home, the walk of this time less what is forgotten of it
        with np.errstate(invalid='ignore'):
            long = np.where(np.isfinite(self._memory),
                            self._memory / 2.0 * -np.expm1(-2.0 * hours / self._memory), hours)
        self.means = self._home + kept * (self.means - self._home)
        self.covariances = self.covariances * np.outer(kept, kept)
        index = np.arange(walk.shape[1])
        self.covariances[:, :, index, index] += walk * long
        self._since += hours

    def observe(self, columns, value, noise, starlike=True):
        """Take an observation.

        Parameters
        ----------
        columns : ndarray, shape (m, n)
            Of each of its values, for unit terms.
        value : ndarray, shape (m,)
            rad.
        noise : ndarray, shape (m,)
            1 sigma, rad.
        starlike : bool
            Whether it may be of a wrong star.

        Returns
        -------
        innovation : ndarray, shape (m,)
            Less what was expected.
        spread : ndarray, shape (m, m)
            Its covariance, as it was expected if nothing has happened.
        """
        columns, value = np.asarray(columns, dtype=float), np.asarray(value, dtype=float)
        variance = np.square(np.asarray(noise, dtype=float))
        off = value - self.means @ columns.T
        spread = (columns @ self.covariances @ columns.T) + np.diag(variance)
        told = self._expected(off, spread)
        chosen = self._chosen(columns, off, spread, starlike)
        self._take(chosen, columns, value, variance)
        self._merge()
        self.count += 1
        self._since = 0.0
        return told

    def _expected(self, off, spread):
        weights = self.weights
        mean = np.einsum('br,brm->m', weights, off)
        beside = off - mean
        return mean, (np.einsum('br,brij->ij', weights, spread)
                      + np.einsum('br,bri,brj->ij', weights, beside, beside))

    def _chosen(self, columns, off, spread, starlike):
        """The stories that go on: (log weight (r,), story before, cause or None) of each."""
        ways = [(None, 0.0)]
        left = 1.0
        for number, jump in enumerate(self._jumps):
            chance = -np.expm1(-jump.per_hour * max(self._since, 1e-3))
            left -= chance
            ways.append((number, np.log(chance)))
        if starlike:
            left -= self._wrong
            ways.append((-1, np.log(self._wrong)))
        ways[0] = (None, np.log(max(left, 1e-3)))
        likely = []
        for cause, prior in ways:
            if cause is None:
                wide = spread
            elif cause < 0:
                wide = np.broadcast_to(
                    np.eye(len(columns)) * self._wrong_sigma**2, spread.shape)
            else:
                side = columns @ self._jumps[cause].shape * self._jumps[cause].sigma
                wide = spread + np.outer(side, side)
            likely.append(prior + self.log_weights + _log_normal(off, wide))
        likely = np.array(likely)  # (way, b, r)
        total = np.logaddexp.reduce(likely.reshape(-1))
        likely -= total
        each = np.exp(likely).sum(axis=2)
        order = np.argsort(-each, axis=None)[:2 * self._most]
        order = order[each.reshape(-1)[order] > 1e-6]
        way, before = np.unravel_index(order, each.shape)
        return [(likely[w, b], b, ways[w][0]) for w, b in zip(way, before)]

    def _take(self, chosen, columns, value, variance):
        before = [b for _, b, _ in chosen]
        causes = np.array([-2 if cause is None else cause for _, _, cause in chosen])
        means, covariances = self.means[before], self.covariances[before].copy()
        for number, jump in enumerate(self._jumps):
            covariances[causes == number] += jump.sigma**2 * np.outer(jump.shape, jump.shape)
        good = causes != -1
        m, p = means[good], covariances[good]
        for column, one, var in zip(columns, value, variance):  # one value after the other
            gain = p @ column
            spread = gain @ column + var
            scaled = gain / spread[..., None]
            m = m + scaled * (one - m @ column)[..., None]
            p = p - scaled[..., :, None] * gain[..., None, :]
        means, covariances = means.copy(), covariances
        means[good], covariances[good] = m, p
        self.means, self.covariances = means, covariances
        self.log_weights = np.array([weight for weight, _, _ in chosen])
        self.stories = [
            self.stories[b] + (() if cause is None else (Event(self.count, cause),))
            for _, b, cause in chosen]

    def _merge(self):
        """Stories that differ only long ago are one; the least likely go."""
        groups = {}
        for place, story in enumerate(self.stories):
            recent = tuple(e for e in story if e.number > self.count - self._depth)
            groups.setdefault(recent, []).append(place)
        weights = np.exp(self.log_weights)
        order = sorted(groups.values(), key=lambda g: -weights[g].sum())[:self._most]
        means, covariances, out, stories = [], [], [], []
        for group in order:
            stories.append(self.stories[group[int(np.argmax(weights[group].sum(axis=1)))]])
            if len(group) == 1:
                place, = group
                means.append(self.means[place])
                covariances.append(self.covariances[place])
                out.append(weights[place])
                continue
            w = weights[group]
            total = w.sum(axis=0)
            share = w / np.maximum(total, 1e-300)
            share[:, total <= 1e-300] = 1.0 / len(group)
            mean = np.einsum('gr,grn->rn', share, self.means[group])
            beside = self.means[group] - mean
            means.append(mean)
            covariances.append(np.einsum('gr,grij->rij', share, self.covariances[group])
                               + np.einsum('gr,gri,grj->rij', share, beside, beside))
            out.append(total)
        self.means, self.covariances = np.array(means), np.array(covariances)
        total = np.array(out)
        with np.errstate(divide='ignore'):
            self.log_weights = np.log(total / total.sum())
        self.stories = stories


def _log_normal(off, spread):
    """Log density of residuals (..., m) of covariance (..., m, m), without its constant."""
    if off.shape[-1] == 2:  # the usual, by hand
        a, b, d = spread[..., 0, 0], spread[..., 0, 1], spread[..., 1, 1]
        x, y = off[..., 0], off[..., 1]
        det = a * d - b * b
        return -0.5 * ((d * x * x - 2.0 * b * x * y + a * y * y) / det + np.log(det))
    solved = np.linalg.solve(spread, off[..., None])[..., 0]
    return -0.5 * (np.sum(off * solved, axis=-1) + np.linalg.slogdet(spread)[1])
