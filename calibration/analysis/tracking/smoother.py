"""The night as it was, in hindsight: terms against time from all that was seen before and after.

A fixed-interval smoother (Rauch, Tung and Striebel 1965) along the story that the whole night
makes likely, for each hypothesis of the rates, in the mean of them.
"""

from dataclasses import dataclass

import numpy as np

from msg_tools.units import ARCSEC

from .filter_start import night_to_night, switched_on
from .hypotheses import passed
from .tracker import WRONG, Tracker

_HOUR = 3.6e12  # ns
#: what a witness shows before its first reading, 1 sigma, rad
_ANYTHING = 3600.0 * ARCSEC


@dataclass(frozen=True)
class Hindsight:
    """Terms of a night, star by star.

    Attributes
    ----------
    stamps : ndarray of int, shape (t,)
        Of the stars that were taken, ns.
    names : tuple of str, length k
    terms, sigma : ndarray, shape (t, k)
        rad.
    events : list of dict
        ``stamp``, ``star`` (its number) and ``what`` has happened before it, or to it.
    """

    stamps: np.ndarray
    names: tuple
    terms: np.ndarray
    sigma: np.ndarray
    events: list

    def document(self):
        """JSON-ready; angles in arcsec."""
        return {'stamps': self.stamps.tolist(), 'events': self.events,
                'terms': {name: {'value_arcsec': (value / ARCSEC).tolist(),
                                 'sigma_arcsec': (sigma / ARCSEC).tolist()}
                          for name, value, sigma in zip(self.names, self.terms.T, self.sigma.T)}}


def hindsight(tracker, night):
    """Terms of a night by all of it.

    Parameters
    ----------
    tracker : Tracker
        As it was when the night began; it is not changed.
    night : sequence of Seen
        In order. What the tracker refuses is left out.

    Returns
    -------
    Hindsight
    """
    live = Tracker.of_state(tracker.state())
    steps, decided, stamp = [], {}, live.stamp
    for seen in night:
        number, noise = live.stars, live.confidence.noise
        if not live.take(seen).taken:
            continue
        step = _Step((seen.stamp - stamp) / _HOUR, number, seen.what == 'star', seen.stamp)
        step.look(live, seen, tracker.plain, noise)
        steps.append(step)
        stamp = seen.stamp
        first = max(number - live.settings.depth + 1, 0)
        decided |= {k: (live.chances(k), live.bank.chance(k)) for k in range(first, number + 1)}
    events = _happened(live, steps, decided)
    means, covariances = _smoothed(tracker, live, steps)
    stars = [i for i, step in enumerate(steps) if step.is_star]
    k = len(live.plain.terms)
    base = np.array(list(tracker.plain.terms.values()))
    return Hindsight(
        np.array([steps[i].stamp for i in stars], dtype=np.int64), tuple(live.plain.terms),
        base + means[stars][:, :k],
        np.sqrt(np.diagonal(covariances[stars], axis1=1, axis2=2)[:, :k]), events)


@dataclass
class _Step:
    """An observation, linear in the terms beyond those of the evening."""

    hours: float
    number: int
    is_star: bool
    stamp: int
    columns: np.ndarray = None
    value: np.ndarray = None
    variance: np.ndarray = None
    wide: np.ndarray = 0.0  # what is added to the covariance just before

    def look(self, live, seen, evening, noise):
        """Take the numbers, in first order about where the live one has the terms by now."""
        plain = live.plain
        if self.hours >= live.settings.gap_h:
            self.wide = night_to_night(live.states, live.mount, live.settings)
        n = len(live.states)
        self.columns, self.value, self.variance = np.zeros((0, n)), np.zeros(0), np.zeros(0)
        if seen.what == 'star':
            az, el, x, y, sigma = seen.values[:5]
            context = seen.values[6] if len(seen.values) > 6 else None
            self.columns = live.columns(np.atleast_1d(az), np.atleast_1d(el))[0]
            moved = np.zeros(n)
            moved[:len(plain.terms)] = (np.array(list(plain.terms.values()))
                                        - list(evening.terms.values()))
            self.value = (np.array([x, y]) - plain.offsets(az, el, context)
                          + self.columns @ moved)
            self.variance = np.square(np.broadcast_to(sigma, (2,)) * noise)
        elif seen.what == 'power_on':
            self.wide = self.wide + switched_on(live.states, live.mount,
                                                *(*seen.values, *_POWER_ON[len(seen.values):]))
        else:
            names, values = _SHOWN[seen.what](*seen.values[:-1])
            self.columns = np.eye(n)[[live.states.index(name) for name in names]]
            self.value = np.array([v - live.reference[name] for name, v in zip(names, values)])
            self.variance = np.full(len(names), seen.values[-1] ** 2)


_POWER_ON = ((0, 1), 60.0 * ARCSEC)
_SHOWN = {'difference': lambda axis, value: ([f'difference_{axis + 1}'], [value]),
          'inclinometer': lambda north, west: (['lean_north', 'lean_west'], [north, west])}


def _happened(live, steps, decided):
    """Events of the night; steps are told of them."""
    events = []
    for number in sorted(decided):
        chances, chance = decided[number]
        what = max(chances, key=chances.get)
        here = [step for step in steps if step.number == number]
        if what == 'nothing' or chances[what] < 0.5 or not here:
            continue
        if what == WRONG:
            star = next((step for step in here if step.is_star), None)
            if star is None:
                continue
            star.columns, star.value, star.variance = star.columns[:0], star.value[:0], []
        else:  # before the first that could see it
            for jump, share in zip(live.bank.jumps, chance):
                if jump.name == what:
                    here[0].wide = here[0].wide + (
                        share / chances[what] * jump.sigma**2 * np.outer(jump.shape, jump.shape))
        events.append({'star': number, 'stamp': here[-1].stamp, 'what': what,
                       'chance': chances[what]})
    return events


def _smoothed(tracker, live, steps):
    """Means, shape (t, n), and covariances, shape (t, n, n), at each step."""
    bank, n = live.bank, len(live.states)
    weights = bank.rate_weights()
    # hypotheses that the night has ruled out cost time and change nothing
    kept = np.flatnonzero(weights > 1e-4)
    weights, walks = weights[kept] / weights[kept].sum(), bank.walks[kept]
    home, first = tracker.bank.estimate()
    first = first.copy()
    for place in range(len(live.plain.terms), n):
        first[place, place] += _ANYTHING**2
    m, p = np.tile(home, (len(kept), 1)), np.tile(first, (len(kept), 1, 1))
    decay = live.decay if live.decay.any() else None
    before, after = [], []
    for step in steps:
        stays, added = passed(walks, decay, step.hours)
        stays = np.ones(n) if stays is None else stays
        m = tracker.bank.home + stays * (m - tracker.bank.home)
        p = p * np.outer(stays, stays) + added + step.wide
        before.append((m, p, stays))
        for column, value, variance in zip(step.columns, step.value, step.variance):
            gain = p @ column
            scaled = gain / (gain @ column + variance)[:, None]
            m = m + scaled * (value - m @ column)[:, None]
            p = p - scaled[:, :, None] * gain[:, None, :]
        after.append((m, p))
    out = [after[-1]] if after else []
    for (m, p), (m_next, p_next, stays) in zip(after[-2::-1], before[:0:-1]):
        back = np.linalg.solve(p_next, stays[:, None] * p).swapaxes(1, 2)
        later = out[-1]
        out.append((m + (back @ (later[0] - m_next)[..., None])[..., 0],
                    p + back @ (later[1] - p_next) @ back.swapaxes(1, 2)))
    out.reverse()
    if not out:
        return np.zeros((0, n)), np.zeros((0, n, n))
    means = np.array([m for m, _ in out])
    mean = np.einsum('r,trn->tn', weights, means)
    off = means - mean[:, None]
    return mean, (np.einsum('r,trij->tij', weights, np.array([p for _, p in out]))
                  + np.einsum('r,tri,trj->tij', weights, off, off))
