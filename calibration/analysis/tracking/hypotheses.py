"""Where the terms are by now: a filter over what may have happened to a mount.

A Gaussian sum: of each story (nothing happened, an axis jumped before that star, that star was a
wrong one) and of each hypothesis of how fast the terms wander a Kalman filter, all of them at
once, each with its weight by Bayes' rule. Nothing is decided that the observations do not decide;
old differences between stories are averaged.

Linear in small terms: Bar-Shalom, Li and Kirubarajan 2001, Estimation with applications to
tracking and navigation, chapters 5 and 11.
"""

from copy import copy
from dataclasses import dataclass

import numpy as np

#: h, the shortest time that counts for the chance of a jump: stamps of one exposure may be alike
_SHORTEST = 1e-3
#: share of all from where a story goes on
_LEAST = 1e-5
#: of a weight that is nothing, so that it can be written as a number
_NOTHING = -700.0


@dataclass(frozen=True)
class TermChange:
    """That something has happened before an observation.

    Attributes
    ----------
    number : int
        Of the star, from 0: before it, or at it.
    cause : int
        Number of the `TermJump`; -1: the star itself is a wrong one.
    """

    number: int
    cause: int


@dataclass(frozen=True)
class TermJump:
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


class Hypotheses:
    """The stories and rates, from one observation to the next.

    Parameters
    ----------
    mean : ndarray, shape (n,) or (r, n)
        Terms to begin with, of all hypotheses or of each, rad.
    covariance : ndarray, shape (n, n) or (r, n, n)
        Of them, rad^2.
    walks : ndarray, shape (r, n, n)
        What an hour of wandering adds to the covariance by each hypothesis, rad^2.
    weights : ndarray, shape (r,), optional
        How likely each is; all alike by default.
    jumps : sequence of Jump
    wrong : float
        Part of the stars that are wrong ones.
    wrong_sigma : float
        1 sigma of what those miss by, rad.
    memory_h : ndarray, shape (n,), optional
        After which a term has gone back to `mean` by a factor e; inf: never.
    turn_h : float
        After which a rate is another one, in the mean; inf: never.
    most : int
        Stories that are kept.
    depth : int
        Stars after which stories that differ only before are one.
    """

    def __init__(self, mean, covariance, walks, weights=None, *, jumps=(), wrong=0.01,
                 wrong_sigma=1e-3, memory_h=None, turn_h=np.inf, most=12, depth=4):
        self.walks = np.array(walks, dtype=float)
        count, n = self.walks.shape[:2]
        mean = np.array(mean, dtype=float)
        self.home = mean if mean.ndim == 1 else mean.mean(axis=0)
        self.jumps = tuple(jumps)
        self._wrong, self._wrong_sigma = wrong, wrong_sigma
        self._most, self._depth, self._turn = most, depth, turn_h
        memory = np.full(n, np.inf) if memory_h is None else np.asarray(memory_h, float)
        self._decay = 1.0 / memory
        self._forgets = bool(self._decay.any())
        start = np.full(count, 1.0 / count) if weights is None else np.asarray(weights, float)
        self.prior = start / start.sum()
        self.means = np.array(np.broadcast_to(mean, (1, count, n)))
        self.covariances = np.array(np.broadcast_to(covariance, (1, count, n, n)), dtype=float)
        self.log_weights = _log(self.prior)[None, :]
        self.stories = [()]
        self.count = 0
        #: log likelihood of all that was observed, but for a constant of each observation
        self.evidence = 0.0
        #: h since an observation last could see each jump
        self.unseen = np.zeros(len(self.jumps))

    def copy(self):
        """Another one of the same state; what is observed by one the other does not know."""
        out = copy(self)
        out.unseen = self.unseen.copy()
        return out

    # --- what it says -------------------------------------------------------------------------

    @property
    def weights(self):
        """Of each story and rate, shape (b, r)."""
        return np.exp(self.log_weights)

    def estimate(self):
        """Mean and covariance of the terms, shapes (n,) and (n, n)."""
        w = self.weights.reshape(-1)
        means = self.means.reshape(len(w), -1)
        mean = w @ means
        off = means - mean
        n = len(mean)
        return mean, ((w @ self.covariances.reshape(len(w), -1)).reshape(n, n)
                      + (off.T * w) @ off)

    def of_stories(self):
        """Weight, mean and covariance of each story: shapes (b,), (b, n) and (b, n, n)."""
        weights = self.weights
        total = weights.sum(axis=1)
        share = weights / total[:, None]
        means = (share[..., None] * self.means).sum(axis=1)
        off = self.means - means[:, None]
        return total, means, (share[..., None, None] * (
            self.covariances + off[..., :, None] * off[..., None, :])).sum(axis=1)

    def mean_walk(self):
        """What an hour adds to the covariance, in the mean of the hypotheses, shape (n, n)."""
        return np.tensordot(self.rate_weights(), self.walks, 1)

    def chance(self, number):
        """How likely each jump before star `number`, and that it was a wrong one.

        Returns
        -------
        ndarray, shape (jumps + 1,)
            The last: a wrong star.
        """
        out = np.zeros(len(self.jumps) + 1)
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
        if hours > 0.0:
            kept, added = passed(self.walks, self._decay if self._forgets else None, hours)
            if kept is not None:
                self.means = self.home + kept * (self.means - self.home)
                self.covariances = self.covariances * np.outer(kept, kept)
            self.covariances = self.covariances + added
            if np.isfinite(self._turn):
                stays = np.exp(-hours / self._turn)
                weights = self.weights
                self.log_weights = _log(stays * weights + (1.0 - stays) * self.prior
                                        * weights.sum(axis=1, keepdims=True))
            self.unseen = self.unseen + hours

    def widen(self, covariance):
        """Something has happened that is known of: an encoder was switched on.

        Parameters
        ----------
        covariance : ndarray, shape (n, n)
            Of what it may have done to the terms, rad^2.
        """
        self.covariances = self.covariances + covariance

    def set(self, place, sigma):
        """A term becomes 0 with an error of its own: it is counted from now on.

        Parameters
        ----------
        place : int
        sigma : float
            rad.
        """
        self.means[..., place] = 0.0
        self.covariances[..., place, :] = 0.0
        self.covariances[..., :, place] = 0.0
        self.covariances[..., place, place] = sigma**2

    def shift(self, by):
        """Terms are counted from another place, shape (n,), rad."""
        self.home = self.home - by
        self.means = self.means - by

    def expected(self, columns, value, noise):
        """What an observation shows beyond what was expected.

        Parameters
        ----------
        columns, value, noise
            As of `observe`.

        Returns
        -------
        innovation : ndarray, shape (m,)
        spread : ndarray, shape (m, m)
            Its covariance, if nothing has happened.
        """
        mean, covariance = self.estimate()
        return value - columns @ mean, (columns @ covariance @ columns.T
                                        + np.diag(np.square(noise)))

    def observe(self, columns, value, noise, starlike=True):
        """Take an observation.

        Parameters
        ----------
        columns : ndarray, shape (m, n)
            Of each of its values, for unit terms; m is 1 or 2.
        value : ndarray, shape (m,)
            rad.
        noise : ndarray, shape (m,)
            1 sigma, rad.
        starlike : bool
            Whether it may be of a wrong star, and counts as one.
        """
        columns = np.asarray(columns, dtype=float)
        variance = np.square(np.asarray(noise, dtype=float))
        b, r, n = self.means.shape
        gains = (self.covariances.reshape(-1, n) @ columns.T).reshape(b, r, n, -1)
        spread = np.matmul(columns, gains) + np.diag(variance)
        off = np.asarray(value, dtype=float) - self.means @ columns.T
        groups, weight = self._chosen(columns, off, spread, starlike)
        self._take(groups, weight, columns, off, gains, spread)
        self.count += starlike

    def _ways(self, columns, starlike):
        """What may have happened just before: cause (None: nothing), log chance and its side."""
        sides, causes, priors, left = [np.zeros(len(columns))], [None], [0.0], 1.0
        seen = []
        for number, jump in enumerate(self.jumps):
            side = columns @ jump.shape
            if not np.abs(side).max() > 1e-9:
                continue
            seen.append(number)
            chance = -np.expm1(-jump.per_hour * max(self.unseen[number], _SHORTEST))
            left -= chance
            sides.append(side * jump.sigma)
            causes.append(number)
            priors.append(np.log(chance))
        self.unseen[seen] = 0.0
        if starlike:
            left -= self._wrong
        priors[0] = np.log(max(left, 1e-3))
        return np.array(sides), causes, np.array(priors)

    def _chosen(self, columns, off, spread, starlike):
        """The stories that go on.

        Returns
        -------
        groups : dict of tuple of Event to list of (int, int or None)
            What is known of each from now on -> story before and cause of those that are it.
        weight : list of ndarray, shape (r,)
            Log weight of each, in the same order.
        """
        sides, causes, priors = self._ways(columns, starlike)
        wide = spread + (sides[:, :, None] * sides[:, None, :])[:, None, None]
        likely = priors[:, None, None] + self.log_weights + _log_normal(off, wide)
        if starlike:
            m = off.shape[-1]
            far = (np.log(self._wrong) - m * np.log(self._wrong_sigma)
                   - 0.5 * np.sum(off * off, axis=-1) / self._wrong_sigma**2)
            likely = np.concatenate((likely, (far + self.log_weights)[None]))
            causes = causes + [-1]
        peak = likely.max()
        each = np.exp(likely - peak)
        total = each.sum()
        self.evidence += float(peak + np.log(total))
        likely = likely - (peak + np.log(total))
        each = each.sum(axis=2) / total
        groups, weights = {}, {}
        for way, before in zip(*np.nonzero(each > _LEAST)):
            story, cause = self.stories[before], causes[way]
            if cause is not None:
                event = TermChange(self.count, cause)
                story = story if event in story else (*story, event)
            recent = tuple(e for e in story if e.number > self.count - self._depth)
            groups.setdefault(recent, []).append((way, before, cause))
            weights[recent] = weights.get(recent, 0.0) + each[way, before]
        kept = sorted(groups, key=lambda recent: -weights[recent])[:self._most]
        return ({recent: [one[1:] for one in groups[recent]] for recent in kept},
                [likely[way, before] for recent in kept for way, before, _ in groups[recent]])

    def _take(self, groups, weight, columns, off, gains, spread):
        flat = [one for group in groups.values() for one in group]
        before = [one[0] for one in flat]
        causes = [one[1] for one in flat]
        m, p = self.means[before], self.covariances[before]
        off, gains, spread = off[before], gains[before], spread[before]
        for place, cause in enumerate(causes):
            if cause is not None and cause >= 0:
                jump = self.jumps[cause]
                side = columns @ jump.shape
                p[place] += jump.sigma**2 * np.outer(jump.shape, jump.shape)
                gains[place] += jump.sigma**2 * np.outer(jump.shape, side)
                spread[place] += jump.sigma**2 * np.outer(side, side)
        scaled = gains @ _inverse(spread)
        if -1 in causes:  # a wrong star teaches nothing
            scaled[np.array(causes) == -1] = 0.0
        m = m + (scaled * off[:, :, None, :]).sum(axis=-1)
        p = p - scaled @ gains.swapaxes(-1, -2)
        self.stories = list(groups)
        weight = np.array(weight)
        if len(flat) > len(groups):
            m, p, weight = _joined(groups.values(), weight, m, p)
        self.means, self.covariances = m, p
        peak = weight.max()
        total = peak + np.log(np.exp(weight - peak).sum())
        self.log_weights = np.maximum(weight - total, _NOTHING)

    # --- what is kept -------------------------------------------------------------------------

    def state(self):
        """All that changes, JSON-ready; `restore` gives it back to the bit."""
        return {'means': self.means.tolist(), 'covariances': self.covariances.tolist(),
                'log_weights': self.log_weights.tolist(), 'unseen': self.unseen.tolist(),
                'count': self.count, 'evidence': self.evidence,
                'stories': [[[e.number, e.cause] for e in story] for story in self.stories]}

    def restore(self, state):
        """Go on where `state` was taken; it was this bank's, by all that it was made with."""
        means = np.array(state['means'], dtype=float)
        if means.ndim != 3 or means.shape[1:] != self.means.shape[1:]:
            raise ValueError(f'state of a filter with other terms or rates, {means.shape[1:]}, '
                             f'than this one, {self.means.shape[1:]}; begin anew')
        self.means = means
        self.covariances = np.array(state['covariances'], dtype=float)
        self.log_weights = np.array(state['log_weights'], dtype=float)
        self.unseen = np.array(state['unseen'], dtype=float)
        self.count, self.evidence = int(state['count']), float(state['evidence'])
        self.stories = [tuple(TermChange(*pair) for pair in story) for story in state['stories']]


def passed(walks, decay, hours):
    """What some time does to terms that wander, or go back to their mean meanwhile.

    Parameters
    ----------
    walks : ndarray, shape (..., n, n)
        What an hour adds to the covariance.
    decay : ndarray, shape (n,), or None
        Of each, 1/h; None: none goes back.
    hours : float

    Returns
    -------
    kept : ndarray, shape (n,), or None
        Factor of what is away from the mean; None: 1.
    added : ndarray, shape (..., n, n)
    """
    if decay is None:
        return None, walks * hours
    both = decay[:, None] + decay
    with np.errstate(invalid='ignore', divide='ignore'):
        length = np.where(both > 0.0, -np.expm1(-both * hours) / both, hours)
    return np.exp(-decay * hours), walks * length


def _joined(groups, weight, means, covariances):
    """Each group as one of the same mean and covariance."""
    out, at = ([], [], []), 0
    for group in groups:
        size = len(group)
        if size == 1:
            one = weight[at], means[at], covariances[at]
        else:
            part = slice(at, at + size)
            peak = weight[part].max(axis=0)
            share = np.exp(weight[part] - peak)
            total = share.sum(axis=0)
            share = share / total
            mean = (share[:, :, None] * means[part]).sum(axis=0)
            off = means[part] - mean
            one = (peak + np.log(total), mean, (share[:, :, None, None] * (
                covariances[part] + off[..., :, None] * off[..., None, :])).sum(axis=0))
        for kept, value in zip(out, one):
            kept.append(value)
        at += size
    weight, means, covariances = (np.array(kept) for kept in out)
    return means, covariances, weight


def _log(weights):
    return np.log(np.maximum(weights, np.exp(_NOTHING)))


def _inverse(spread):
    """Of matrices (..., m, m), m 1 or 2."""
    if spread.shape[-1] == 1:
        return 1.0 / spread
    a, b, d = spread[..., 0, 0], spread[..., 0, 1], spread[..., 1, 1]
    out = np.empty_like(spread)
    det = a * d - b * b
    out[..., 0, 0], out[..., 1, 1] = d / det, a / det
    out[..., 0, 1] = out[..., 1, 0] = -b / det
    return out


def _log_normal(off, spread):
    """Log density of residuals (..., m) of covariance (..., m, m), without its constant."""
    if off.shape[-1] == 1:
        s = spread[..., 0, 0]
        return -0.5 * (off[..., 0] ** 2 / s + np.log(s))
    a, b, d = spread[..., 0, 0], spread[..., 0, 1], spread[..., 1, 1]
    x, y = off[..., 0], off[..., 1]
    det = a * d - b * b
    return -0.5 * ((d * x * x - 2.0 * b * x * y + a * y * y) / det + np.log(det))
