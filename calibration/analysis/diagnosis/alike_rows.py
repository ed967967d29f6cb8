"""How rows that err alike differ: measured in what is left of them, as a reader would."""

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.effects.base import arcsec
from pointing_model.rms import rms

_ANCHORS = 400  # rows of which the pairs are looked at, at most
_ABOUT = 0.5  # of the distance in the order, by which a pair may be nearer or farther
_NEAR = 5.0  # deg on the sky, within which two rows are near at least
_FEWEST = 10  # pairs, of which a figure is told


class Seen:
    """Differences of what is left of two rows, RMS on the sky, by how far they are apart.

    Parameters
    ----------
    context : Context
    sequence : Sequence
    residual : ndarray, shape (2, n)
        What is left, radians.
    live : ndarray of bool, shape (n,)
        Rows with weight.
    apart : float
        In the order, in units of the sequence's position.
    """

    def __init__(self, context, sequence, residual, live, apart):
        rows = sequence.order[live[sequence.order]]
        places = context.mount.direction(context.az, context.el).T[rows]
        position, run, m = sequence.position[rows], sequence.run[rows], len(rows)
        self._left = residual[:, rows]
        first, second = np.arange(max(m - 1, 0)), np.arange(1, m)
        self._next = _of(run, first, second)
        anchors = np.unique(np.linspace(0, m - 1, min(m, _ANCHORS)).astype(int))
        first, second = (v.ravel() for v in np.meshgrid(anchors, np.arange(m), indexing='ij'))
        # of two anchors each pair is there twice: that changes no mean
        first, second = _of(run, first[first != second], second[first != second])
        since = np.abs(position[first] - position[second])
        self._far = [v[np.abs(since - apart) <= _ABOUT * apart] for v in (first, second)]
        between = _between(places, *self._next)
        #: degrees on the sky
        self.within = max(float(np.median(between)) if len(between) else 0.0, _NEAR)
        self._near_next = [v[between <= self.within] for v in self._next]
        later = (since >= apart) & (_between(places, first, second) <= self.within)
        self._near_later = [v[later] for v in (first, second)]

    def pairs(self):
        """How many pairs are near on the sky and far in the order."""
        low, high = (np.sort(self._near_later, axis=0) if len(self._near_later[0])
                     else np.zeros((2, 0), int))
        return len(set(zip(low.tolist(), high.tolist())))

    def to_dict(self, axis):
        """Of an axis (0 or 1), arcsec; None of too few pairs.

        Returns
        -------
        dict
            ``next_arcsec`` (a row and the next), ``apart_arcsec`` (rows about so far apart),
            ``moves_arcsec`` (by how much more that is: the root of the difference of the squares);
            ``near_next_arcsec``, ``near_apart_arcsec``: of rows `within` on the sky, a row and
            the next, and those farther apart in the order.
        """
        near, far = (self._differ(axis, pair) for pair in (self._next, self._far))
        return {'next_arcsec': near, 'apart_arcsec': far,
                'moves_arcsec': None if None in (near, far) else float(np.sqrt(
                    max(far**2 - near**2, 0.0))),
                'near_next_arcsec': self._differ(axis, self._near_next),
                'near_apart_arcsec': self._differ(axis, self._near_later)}

    def _differ(self, axis, pair):
        first, second = pair
        if len(first) < _FEWEST:
            return None
        return float(rms(self._left[axis, first] - self._left[axis, second]) / ARCSEC)


def _of(run, first, second):
    same = run[first] == run[second]
    return first[same], second[same]


def _between(places, first, second):
    chord = np.linalg.norm(places[first] - places[second], axis=1)
    return np.degrees(2.0 * np.arcsin(np.minimum(0.5 * chord, 1.0)))


def seen_sentence(axes, words, said):
    """How much more rows differ that are farther apart; '' where that is not known.

    Parameters
    ----------
    axes : dict of str to dict
        ``az``, ``el``: as of `Seen.to_dict`.
    words : sequence of str
        What the angles are called.
    said : str
        How far apart, in words.
    """
    told = [(word, axes[name]) for name, word in zip(('az', 'el'), words)
            if name in axes and axes[name]['moves_arcsec'] is not None]
    if not told:
        return ''
    near, far = (' and '.join(f'{arcsec(one[key])} in {word}' for word, one in told)
                 for key in ('next_arcsec', 'apart_arcsec'))
    text = (f'What is left of a row and of the next differs by {near}, of rows about {said} apart '
            f'by {far} (RMS on the sky, noise included)')
    if not any(one['moves_arcsec'] for _, one in told):
        text += ': no more, so it is from row to row that they err alike, if at all'
    return text


def direction_sentence(axes, words, said, within, pairs):
    """Whether rows of one direction err alike whenever they were observed; '' if not known."""
    told = [(word, axes[name]) for name, word in zip(('az', 'el'), words) if name in axes and None
            not in (axes[name]['near_next_arcsec'], axes[name]['near_apart_arcsec'])]
    if not told or pairs < _FEWEST:
        return ''
    near, far = (' and '.join(f'{arcsec(one[key])} in {word}' for word, one in told)
                 for key in ('near_next_arcsec', 'near_apart_arcsec'))
    return (f'Rows within {within:.0f}° on the sky differ by {near} where one follows the other, '
            f'by {far} where they are {said} or more apart ({pairs} pairs): an error of the '
            'direction leaves the two alike, a zero that wanders makes the second as large as that '
            'of rows anywhere')
