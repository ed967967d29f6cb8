"""A model that follows its mount: what stars and witnesses say, one after the other.

    tracker = Tracker(model, stamp)                  # of a file or a fit, with its covariance
    heard = tracker.star(stamp, az, el, x, y, sigma)
    tracker.model(), tracker.expected(az, el, seconds_ahead=600.0), heard.called

`x, y` is encoder - catalogue on the sky with the star centred, as `PointingRun.offsets` has it
(zero taken off). Whoever pointed through a model and measured a miss distance has
``model.offsets(az, el) + miss``. All that a tracker becomes follows from what it was told in
order, to the bit: `state` and `of_state` go on where it was.
"""

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.model import PointingModel
from pointing_model.mounts import told
from pointing_model.terms import design

from . import tracker_state as kept
from .filter_confidence import Confidence
from .filter_start import complete, night_to_night, switched_on
from .hypotheses import Hypotheses, passed
from .measurements import Expected, Heard
from .motion_causes import (
    ABSOLUTE,
    INCREMENTAL,
    WITNESSES,
    TrackingSettings,
    hypotheses,
    jumps_of,
    states_of,
)

#: from where it is said that something has happened
SURE = 0.65
#: beyond this the model of the evening is moved to where the terms are: columns are first order
_FAR, _ROUNDS = 30.0 * ARCSEC, 3
_HOUR = 3.6e12  # ns
WRONG = 'wrong star'


class Tracker:
    """The terms by now, from a model of the evening.

    Parameters
    ----------
    model : PointingModel
        With the covariance of its terms. Zeros that it does not have are added, unknown within
        `held_terms.BROAD`. Harmonics and effects stay as they are.
    stamp : int
        When the model held, ns.
    mount : Mount, optional
        The mount that is observed, to be compared with the model's.
    witnesses : sequence of str
        ``difference``: absolute - incremental encoder of each axis; ``inclinometer``.
    settings : TrackingSettings, optional
    rate_weights : ndarray, shape (r,), optional
        How likely each of `facts` is, as `history.rates_of_nights` gives it.

    Attributes
    ----------
    notes : list of str
        What was widened in the model.
    facts : list of dict
        The hypotheses of the rates.
    stamp : int
        Of the last that was taken, ns.
    mount : Mount
    bank, plain, settings, ... :
        What `kept` writes down.

    Raises
    ------
    ValueError
        A model of another mount, a covariance that is none, an unknown witness.
    """

    def __init__(self, model, stamp, *, mount=None, witnesses=(), settings=None,
                 rate_weights=None):
        settings = settings or TrackingSettings()
        if mount is not None and not mount.agrees(model.mount):
            raise ValueError(f'a model of another mount ({told(model.mount)}) than the one that '
                             f'is observed ({told(mount)}); fit this mount')
        unknown = [name for name in witnesses if name not in WITNESSES]
        if unknown:
            raise ValueError(f'unknown witness {unknown[0]!r}; choose from '
                             f'{", ".join(WITNESSES)}')
        self.notes = []
        terms, covariance = complete(model, self.notes)
        self._names, self.mount = tuple(terms), model.mount
        self.plain = PointingModel(terms, covariance, model.harmonics, model.provenance,
                                    model.geometry, model.effects, model.mount)
        self.witnesses, self.settings = tuple(witnesses), settings
        self.states = states_of(self._names, witnesses)
        n, k = len(self.states), len(terms)
        self._walks, self.facts = hypotheses(self._names, self.mount, witnesses, settings)
        unknown = [name for name in (*settings.walks, *settings.memory_h)
                   if name not in self._names]
        if unknown:
            raise ValueError(f'tracking: no term {unknown[0]} in the model; choose from '
                             f'{", ".join(self._names)}')
        whole = np.zeros((n, n))
        whole[:k, :k] = covariance
        self.decay = np.array([1.0 / settings.memory_h.get(s, np.inf) for s in self.states])
        self.given_weights = None if rate_weights is None else [float(v) for v in rate_weights]
        self.bank = Hypotheses(
            np.zeros(n), whole, self._walks, self.given_weights,
            jumps=jumps_of(self._names, self.mount, witnesses, settings), wrong=settings.wrong,
            wrong_sigma=settings.wrong_sigma, turn_h=settings.turn_h, most=settings.most,
            depth=settings.depth,
            memory_h=[settings.memory_h.get(s, np.inf) for s in self.states])
        self._fastest = np.array([fact['zero'] == max(settings.zeros) for fact in self.facts],
                                 dtype=float)
        self.stamp, self.last_star = int(stamp), None
        self.reference = {}  # witness -> its first reading
        self.confidence = Confidence()
        self.waiting, self.said = [], []  # (number, innovation), (number, name)

    # --- what it says -------------------------------------------------------------------------

    @property
    def stars(self):
        """How many were taken."""
        return self.bank.count

    def terms(self):
        """Terms by now, rad, and their covariance, shape (k, k)."""
        mean, covariance = self.bank.estimate()
        k = len(self._names)
        values = {name: value + float(off) for (name, value), off
                  in zip(self.plain.terms.items(), mean)}
        return values, covariance[:k, :k]

    def model(self):
        """The `PointingModel` by now."""
        terms, covariance = self.terms()
        return PointingModel(
            terms, covariance, self.plain.harmonics,
            {**self.plain.provenance, 'tracked': {'stars': self.stars, 'stamp': self.stamp}},
            self.plain.geometry, self.plain.effects, self.mount)

    def expected(self, az, el, seconds_ahead=0.0):
        """How far the model of now will be off, with what drifts unseen until then.

        Parameters
        ----------
        az, el : float or ndarray, shape (p,)
            Places by the axes of the mount, rad.
        seconds_ahead : float
            Since the last observation.

        Returns
        -------
        Expected
            Of shape (p, 2, 2). Without the effects of the model, and without a jump, of which
            only the chance is told.
        """
        az, el = np.broadcast_arrays(*np.atleast_1d(az, el))
        columns, covariance = self.columns(az, el), self.ahead(seconds_ahead)
        out = columns @ covariance @ columns.swapaxes(-1, -2)
        series = self.plain.harmonics
        if series is not None:
            out = out + np.array(series.variance(az, el)).T[:, :, None] * np.eye(2)
        often = sum(jump.per_hour for jump in self.bank.jumps)
        return Expected(out, float(-np.expm1(-often * seconds_ahead / 3600.0)))

    def ahead(self, seconds):
        """How far the states will be from what they are thought to be now.

        Parameters
        ----------
        seconds : float
            Since the last observation.

        Returns
        -------
        ndarray, shape (n, n)
            Mean square, rad^2.
        """
        mean, covariance = self.bank.estimate()
        stays, added = passed(self.bank.mean_walk(),
                              self.decay if self.decay.any() else None, seconds / 3600.0)
        if stays is not None:
            gone = (stays - 1.0) * (mean - self.bank.home)
            covariance = covariance * np.outer(stays, stays) + np.outer(gone, gone)
        return covariance + added

    def rates(self):
        """How fast zeros and lean wander by now, rad in the root of an hour, and who.

        Returns
        -------
        dict
            ``zero`` and ``tilt`` (root of the mean square) and, with both encoders, ``who``:
            how likely each is the one that wanders.
        """
        weights = self.bank.rate_weights()
        out = {name: float(np.sqrt(weights @ [fact[name] ** 2 for fact in self.facts]))
               for name in ('zero', 'tilt')}
        if self.facts[0]['who']:
            out['who'] = {who: float(sum(w for w, f in zip(weights, self.facts)
                                         if f['who'] == who))
                          for who in dict.fromkeys(fact['who'] for fact in self.facts)}
        return out

    @property
    def rate_weights(self):
        """How likely each of `facts` is by now, shape (r,)."""
        return self.bank.rate_weights()

    def chances(self, number):
        """What may have happened before a star, by name; see `Heard.chances`.

        Parameters
        ----------
        number : int
            Of the star, from 0.
        """
        chance = self.bank.chance(number)
        out = {}
        for jump, value in zip(self.bank.jumps, chance):
            out[jump.name] = out.get(jump.name, 0.0) + float(value)
        out[WRONG] = float(chance[-1])
        return {'nothing': max(0.0, 1.0 - sum(out.values())), **out}

    # --- what it is told ----------------------------------------------------------------------

    def take(self, seen):
        """Take a `Seen`, whatever it is of."""
        return getattr(self, seen.what)(seen.stamp, *seen.values)

    def star(self, stamp, az, el, x, y, sigma, name='', context=None):
        """Take a star, or Polaris.

        Parameters
        ----------
        stamp : int
            ns.
        az, el : float
            Catalogue place by the axes of the mount, rad.
        x, y : float
            Encoder - catalogue, on the sky, with the star centred, rad.
        sigma : float or (float, float)
            1 sigma of the noise of each, rad.
        name : str
        context : Context or dict, optional
            Drivers of the model's effects.

        Returns
        -------
        Heard
        """
        sigma = np.broadcast_to(np.asarray(sigma, float), (2,))
        stamp, why = self._refused(stamp, (az, el, x, y), sigma)
        if not why and stamp == self.last_star:
            why = f'star {name}: there is one of this stamp already; it counts once'
        value = np.array([x, y]) - self.plain.offsets(az, el, context) if not why else np.zeros(2)
        if not np.isfinite(value).all():
            why = f'star {name}: the mount cannot look there by the model; check the place'
        if why:
            return Heard(stamp, 'star', False, why)
        why = self._wait(stamp)
        columns = self.columns(np.atleast_1d(az), np.atleast_1d(el))[0]
        noise, number = sigma * self.confidence.noise, self.bank.count
        innovation, spread = self.bank.expected(columns, value, noise)
        for _ in range(_ROUNDS):  # where terms go far, again about where they went
            before = self.bank.copy()
            self.bank.observe(columns, value, noise)
            far = self.bank.estimate()[0]
            if np.abs(far[:len(self._names)]).max() < _FAR:
                break
            self.bank = before
            self._move(far)
            value = np.array([x, y]) - self.plain.offsets(az, el, context)
        else:
            self.bank.observe(columns, value, noise)
        self.last_star = stamp
        self.waiting.append((number, np.linalg.solve(
            np.linalg.cholesky(spread), innovation).tolist()))
        called, confidence = self._called(number), self._judged(number)
        return Heard(stamp, 'star', True, why, innovation, spread, self.chances(number), called,
                     confidence)

    def difference(self, stamp, axis, value, sigma):
        """Take absolute - incremental encoder of an axis; its first says what it was.

        Parameters
        ----------
        stamp : int
            ns.
        axis : int
            0 or 1.
        value, sigma : float
            rad.

        Returns
        -------
        Heard
        """
        return self._witness(stamp, 'difference', {f'difference_{axis + 1}': value}, sigma)

    def inclinometer(self, stamp, north, west, sigma):
        """Take how much the base leans to the north and to the west; the first says how it was.

        Parameters
        ----------
        stamp : int
            ns.
        north, west, sigma : float
            rad.

        Returns
        -------
        Heard
        """
        return self._witness(stamp, 'inclinometer', {'lean_north': north, 'lean_west': west},
                             sigma)

    def _witness(self, stamp, what, values, sigma):
        places = [self.states.index(name) if name in self.states else -1 for name in values]
        if min(places) < 0:
            return Heard(int(stamp), what, False, f'{what}: not among the witnesses that this '
                         'filter was made with; name it there')
        stamp, why = self._refused(stamp, values.values(), [sigma])
        if why:
            return Heard(stamp, what, False, why)
        why = self._wait(stamp)
        for place, (name, value) in zip(places, values.items()):
            if name not in self.reference:
                self.reference[name] = float(value)
                self.bank.set(place, float(sigma))
        columns = np.eye(len(self.states))[places]
        value = np.array([value - self.reference[name] for name, value in values.items()])
        noise = np.full(len(places), float(sigma))
        innovation, spread = self.bank.expected(columns, value, noise)
        number = self.bank.count
        self.bank.observe(columns, value, noise, starlike=False)
        return Heard(stamp, what, True, why, innovation, spread, self.chances(number),
                     self._called(number))

    def power_on(self, stamp, axes=(0, 1), sigma=60.0 * ARCSEC):
        """The incremental encoder was switched on, or homed: its zero is another one.

        Parameters
        ----------
        stamp : int
            ns.
        axes : sequence of int
        sigma : float
            By how much, rad.

        Returns
        -------
        Heard
        """
        stamp, why = self._refused(stamp, (), [sigma])
        if why:
            return Heard(stamp, 'power_on', False, why)
        why = self._wait(stamp)
        self.bank.widen(switched_on(self.states, self.mount, axes, sigma))
        return Heard(stamp, 'power_on', True, why, np.zeros(0), np.zeros((0, 0)), {})

    # --- inside -------------------------------------------------------------------------------

    def columns(self, az, el):
        """What unit states do to stars on the sky, shape (p, 2, n)."""
        out = np.zeros((len(az), 2, len(self.states)))
        out[:, 0, :len(self._names)], out[:, 1, :len(self._names)] = design(
            self._names, az, el, self.mount)
        return out

    def _refused(self, stamp, values, sigmas):
        if not np.isfinite(stamp):
            return 0, 'a stamp that is no number'
        stamp = int(stamp)
        if stamp < self.stamp:
            return stamp, (f'stamp {(self.stamp - stamp) * 1e-9:.3f} s before the last one; what '
                           'is late is not taken')
        if not np.isfinite(list(values)).all():
            return stamp, 'a value that is not finite'
        if not all(np.isfinite(s) and s > 0.0 for s in sigmas):
            return stamp, 'a sigma that is not finite and positive'
        return stamp, ''

    def _wait(self, stamp):
        hours = (stamp - self.stamp) / _HOUR
        self.bank.wait(hours)
        self.stamp = stamp
        if hours < self.settings.gap_h:
            return ''
        self.bank.widen(night_to_night(self.states, self.mount, self.settings))
        return (f'nothing for {hours:.1f} h: zeros and lean are widened as from one night to the '
                'next')

    def _called(self, number):
        """What is decided of the last stars and was not before."""
        out = []
        first = number - self.settings.depth
        self.said = [one for one in self.said if one[0] > first]
        for before in range(max(first + 1, 0), number + 1):
            for name, chance in self.chances(before).items():
                if name == 'nothing' or chance < SURE or (before, name) in self.said:
                    continue
                # a star alone does not tell a jump from a wrong star; the encoders do
                if before < number or name == WRONG or name.startswith((INCREMENTAL, ABSOLUTE)):
                    self.said.append((before, name))
                    what = (f'star {before} is a {WRONG}' if name == WRONG else
                            f'{name}: jumped before star {before}')
                    out.append(f'{what} ({100.0 * chance:.0f} %)')
        return tuple(out)

    def _judged(self, number):
        """The verdict of the stars by now long enough ago."""
        out = ''
        while self.waiting and self.waiting[0][0] <= number - self.settings.depth + 1:
            before, off = self.waiting.pop(0)
            if self.chances(before)['nothing'] > 0.5:
                out = self.confidence.add(off, self._fastest @ self.bank.rate_weights()) or out
        self.take_confidence()
        return out

    def take_confidence(self):
        """Drifts are as fast as `confidence` has it."""
        self.bank.walks = self._walks * self.confidence.walk**2

    def _move(self, far):
        """The model that terms are counted from goes by `far`, shape (n,)."""
        plain, k = self.plain, len(self._names)
        terms = {name: value + float(off) for (name, value), off in zip(plain.terms.items(), far)}
        self.plain = PointingModel(terms, plain.covariance, plain.harmonics, plain.provenance,
                                   plain.geometry, plain.effects, plain.mount)
        moved = np.zeros(len(far))
        moved[:k] = [self.plain.terms[name] - value for name, value in plain.terms.items()]
        self.bank.shift(moved)

    def state(self):
        """All that it is, as a JSON text; `of_state` gives it back to the bit."""
        return kept.to_json(self)

    @classmethod
    def of_state(cls, text, mount=None):
        """The tracker that wrote a `state`.

        Parameters
        ----------
        text : str
        mount : Mount, optional
            That is observed.

        Raises
        ------
        ValueError
            It is no such state, of a later version, or of another mount.
        """
        return kept.of_json(text, cls, mount)
