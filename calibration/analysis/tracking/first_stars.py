"""The first stars of a night whose model tells of the nights before.

A model of `telescope-mount season` has in its provenance what the terms have been from night to
night (`PAST`) and how fast they wander within one (`RATES`). With these a tracked night begins:
the first stars decide between the stories of `few_stars`, and from then on a `Tracker` follows.
"""

from dataclasses import replace

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.model import PointingModel
from pointing_model.terms import design

from .history import Past
from .warm_start import STARS, begin

#: keys of a model's provenance
PAST, RATES = 'past', 'rates'
#: columns are first order about the terms: offsets are taken again about where they went
_ROUNDS = 2


def past_document(past):
    """A `Past`, JSON-ready; rad and rad^2."""
    return {'names': list(past.names), 'noise': past.noise, **{
        name: getattr(past, name).tolist()
        for name in ('mean', 'covariance', 'last', 'last_covariance')}}


def past_of(model):
    """What a model tells of the nights before, a `Past`; None where it tells nothing.

    Raises
    ------
    ValueError
        It is damaged, or of other terms than the model.
    """
    told = model.provenance.get(PAST)
    if told is None:
        return None
    try:
        arrays = {name: np.array(told[name], dtype=float)
                  for name in ('mean', 'covariance', 'last', 'last_covariance')}
        past = Past(tuple(told['names']), noise=float(told['noise']), **arrays)
    except (KeyError, TypeError, ValueError) as err:
        raise ValueError(f'what the model tells of earlier nights is damaged: {err!r:.80}; make '
                         'it again (telescope-mount season)') from None
    k = len(model.terms)
    shapes = {'mean': (k,), 'last': (k,), 'covariance': (k, k), 'last_covariance': (k, k)}
    if past.names != tuple(model.terms) or not past.noise > 0.0 or any(
            arrays[name].shape != shape or not np.isfinite(arrays[name]).all()
            for name, shape in shapes.items()):
        raise ValueError('what the model tells of earlier nights is of other terms, or no number: '
                         'make it again (telescope-mount season)')
    return past


def rates_document(rates):
    """`history.Rates`, JSON-ready: each walk of zeros and lean, and how likely it is."""
    return [{'zero_arcsec': fact['zero'] / ARCSEC, 'lean_arcsec': fact['tilt'] / ARCSEC,
             'chance': float(weight)} for fact, weight in zip(rates.facts, rates.weights)]


def weights_of(told, facts):
    """How likely each hypothesis of a tracker is, by `rates_document`.

    Parameters
    ----------
    told : list of dict or None
    facts : list of dict
        As `Tracker.facts`; those that differ only by who wanders share a chance.

    Returns
    -------
    ndarray, shape (r,), or None
        None where nothing is told, or of other walks than these.
    """
    if told is None:
        return None
    try:
        known = [(float(row['zero_arcsec']) * ARCSEC, float(row['lean_arcsec']) * ARCSEC,
                  float(row['chance'])) for row in told]
    except (KeyError, TypeError, ValueError) as err:
        raise ValueError(f'what the model tells of rates is damaged: {err!r:.80}; make it again '
                         '(telescope-mount season)') from None
    out = np.array([sum(chance for zero, lean, chance in known
                        if np.allclose((zero, lean), (fact['zero'], fact['tilt']), 1e-6))
                    for fact in facts])
    return out / out.sum() if np.all(out > 0.0) else None


class Opening:
    """The model after each of the first stars.

    Parameters
    ----------
    model : PointingModel
        With the terms of `past`.
    past : Past

    Attributes
    ----------
    begun : few_stars.Begun or None
        By the stars so far.
    """

    def __init__(self, model, past):
        self._model, self.begun = model, None
        # deviations from the last night
        self._past = replace(past, mean=past.mean - past.last, last=np.zeros(len(past.last)))
        self._last = past.last
        self._columns, self._seen = [], []

    @property
    def stars(self):
        """How many were taken."""
        return len(self._seen)

    @property
    def over(self):
        """Whether a `Tracker` goes on from here."""
        return self.stars >= STARS

    def take(self, az, el, x, y, context=None):
        """Take a star; what they all say by now, `few_stars.Begun`.

        Parameters
        ----------
        az, el, x, y, context
            As of `Tracker.star`.
        """
        self._columns.append(np.stack(design(self._past.names, np.atleast_1d(az),
                                             np.atleast_1d(el), self._model.mount), axis=1)[0])
        self._seen.append((az, el, np.array([x, y]), context))
        columns, off = np.array(self._columns), np.zeros(len(self._last))
        for _ in range(_ROUNDS):
            base = self._with(self._last + off, self._past.covariance)
            offsets = np.array([
                seen - base.offsets(own_az, own_el, own)
                for own_az, own_el, seen, own in self._seen]) + columns @ off
            self.begun = begin(self._past, columns, offsets, mount=self._model.mount)
            off = np.array(list(self.begun.terms.values()))
        return self.begun

    def model(self):
        """The `PointingModel` by now."""
        off = np.array(list(self.begun.terms.values()))
        return self._with(self._last + off, self.begun.covariance)

    def _with(self, terms, covariance):
        plain = self._model
        return PointingModel(
            dict(zip(self._past.names, map(float, terms))), covariance, plain.harmonics,
            plain.provenance, plain.geometry, plain.effects, plain.mount)

    def document(self):
        """How likely each story is, JSON-ready."""
        return {'stars': self.stars, 'of': STARS,
                'chances': self.begun.chances if self.begun else None}

    def sentence(self):
        """What has happened since the nights before, for people."""
        chance = self.begun.chances[self.begun.story]
        return (f'since the last night: {self.begun.story} ({100.0 * chance:.0f} %), by '
                f'{self.stars} stars')
