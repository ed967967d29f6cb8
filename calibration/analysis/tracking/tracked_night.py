"""A night that is tracked: rows as the observer takes them, and the model after each.

The model that it begins with stands in the provenance of every model that comes of it, so that
who has the last one and the rows of the night has all: the same rows give the same numbers, here,
after a restart and from the log.
"""

import json
from dataclasses import replace

import numpy as np

from msg_tools.units import ARCSEC, wrap
from pointing_model.context import Context
from pointing_model.held_terms import BROAD
from pointing_model.model_document import KEY, from_document
from pointing_model.runs.run import PointingRun
from pointing_model.zero import RunZero

from ...distrust import distrusted
from ...rows import is_kept_out
from ..camera_faults import SAME_ROWS
from .first_stars import PAST, RATES, Opening, past_of, weights_of
from .measurements import Seen
from .smoother import hindsight
from .tracker import Tracker

#: noise of a star where the model does not tell what it left, rad
NOISE = 1.5 * ARCSEC
#: events and innovations that are told of: the last ones
MOST_EVENTS, MOST_NIS = 50, 500
#: 95 % of chi squared with two degrees of freedom
_BEYOND = -2.0 * np.log(0.05)
#: readings from which the noise of absolute - incremental encoder is found
_FEWEST = 8


class TrackedNight:
    """A tracker that is fed with rows of observations.

    Parameters
    ----------
    model : PointingModel
        To begin with. One that tells of the nights before (`opening`) stands for them: the first
        stars decide what has happened since.
    zero : RunZero
        That goes with it; of another power-on it is widened.
    stamp : int
        When the model held, ns; rows up to then are in it.
    noise : (float, float), optional
        1 sigma of a star along x and y, rad; by default what the model left of its own rows.
    difference, lean : dict, optional
        Absolute - incremental encoder up to then, of `difference_of`, and what the base leans, of
        `lean_of`; None: it is no witness.
    rates : list of dict, optional
        How fast such nights wander, as of `opening.rates_document`; by default what the model
        tells of it.

    Attributes
    ----------
    zero : RunZero
        Taken off all readings. It stays: the index terms follow.
    heard : list of heard.Heard
        Of the rows that were taken last.
    seen : list of heard.Seen or None
        What the tracker was told since `keep`.
    """

    def __init__(self, model, zero, stamp, noise=None, difference=None, lean=None, rates=None):
        self._begin(json.loads(model.to_json()), zero, int(stamp), noise or _noise_of(model),
                    difference, lean, rates or model.provenance.get(RATES))

    def _begin(self, document, zero, stamp, noise, difference, lean, rates):
        # what is written down and read again is the model, here as anywhere else
        self._document, self._evening = document, from_document(document)
        # as it comes back from the column of times
        self._began, self.zero, self._first_zero = _rounded(stamp * 1e-9), zero, zero
        self._noise, self._difference, self._lean = tuple(noise), difference, lean
        self._absolute_start = difference and difference['absolute_start']
        self._last, self._taken = [], self._began  # rows; stamp of the last one
        self._events, self._nis = [], []  # what was called; of stars before which nothing happened
        self.heard, self.seen, self._at_first = [], None, None
        self._rates = rates
        self._witnesses = [name for name, told in (
            ('difference', difference), ('inclinometer', lean)) if told]
        self._tracker = self._tracker_of(self._evening, self._began)
        past = past_of(self._evening)
        self._opening = None if past is None else Opening(self._evening, past)
        self._opened = None  # how likely each story of the opening was
        for axis, apart in enumerate(difference['apart'] if difference else ()):
            self._tracker.difference(self._began, axis, apart, difference['sigma'][axis])
        if lean:
            self._tracker.inclinometer(self._began, *lean['lean'], lean['sigma'])

    def _tracker_of(self, model, stamp):
        tracker = Tracker(model, stamp, witnesses=self._witnesses)
        weights = weights_of(self._rates, tracker.facts)
        return tracker if weights is None else Tracker(
            model, stamp, witnesses=self._witnesses, rate_weights=weights)

    @classmethod
    def of_model(cls, model):
        """The night as it began, from a model that came of it; it has to take its rows again.

        Raises
        ------
        ValueError
            It did not, or what it tells of it is damaged.
        """
        told = model.provenance.get(KEY)
        if not isinstance(told, dict) or 'evening' not in told:
            raise ValueError('a model that was not tracked')
        begun, out = told['evening'], cls.__new__(cls)
        try:
            zero = RunZero(*begun['zero_rad'], run=begun['run'], started=begun['encoder_start'])
            out._begin(begun['model'], zero, begun['stamp'], begun['noise'], begun['difference'],
                       begun['lean'], begun.get('rates'))
        except (KeyError, TypeError) as err:
            raise ValueError(f'the evening of a tracked model is damaged: {err}') from None
        return out

    def keep(self):
        """Keep what is told from now on, for `hindsight`."""
        self.seen, self._at_first = [], self._tracker.state()

    def hindsight(self):
        """The night as it was, a `hindsight.Hindsight`; since `keep`."""
        return hindsight(Tracker.of_state(self._at_first), self.seen)

    @property
    def stars(self):
        """How many were taken."""
        return self._tracker.stars

    def take(self, rows):
        """Take rows of the night; those before the begin are in the model already.

        Parameters
        ----------
        rows : PointingRun
            In order. Rows to judge by, satellites and what is not trusted are left out.

        Returns
        -------
        list of heard.Heard
            Of each star that was looked at, and of witnesses where they make something known;
            also in `heard`.

        Raises
        ------
        ValueError
            The rows have no time.
        """
        if 'time' not in rows:
            raise ValueError('observation without column time')
        self.heard = []
        for i in range(len(rows)):
            own = rows.select([i])
            stamp = _rounded(own['time'][0])
            if stamp <= self._taken:
                continue  # it is known, or in the model of the evening
            self._taken = stamp
            # one that froze is known by the rows before it, never by those after
            self._last = [*self._last[1 - SAME_ROWS:], own]
            if own['star'][0] < 0 or is_kept_out(own)[0] or distrusted(
                    PointingRun.concatenate(self._last))[-1]:
                continue
            self._note_power_on(own, stamp)
            if self._difference:
                self._take_difference(own, stamp)
            if self._lean and 'lean_north' in own and np.isfinite(own['lean_north'][0]):
                self._hear(self._tell('inclinometer', stamp, (
                    float(own['lean_north'][0]), float(own['lean_west'][0]),
                    self._lean['sigma'])))
            heard = self._take_star(stamp, (
                float(own['az'][0]), float(own['el'][0]), *self._offsets(own), self._noise,
                f'{own["star"][0]:.0f}', Context.of_run(own) if self._evening.effects else None))
            self.heard.append(heard)
            self._note(heard)
        return self.heard

    def _take_star(self, stamp, values):
        """To the tracker; one of the first of a night to what it is made of."""
        opening = self._opening
        if opening is None:
            return self._tell('star', stamp, values)
        heard = self._tracker.star(stamp, *values)  # what was expected before it
        if not heard.taken:
            return heard
        *place_and_offset, _, _, context = values
        opening.take(*place_and_offset, context)
        self._tracker = self._tracker_of(opening.model(), stamp)
        self._tracker.bank.count = opening.stars
        self._opened = opening.document()
        heard = replace(heard, chances=dict.fromkeys(heard.chances, 0.0), called=(), confidence='')
        if opening.over:
            self._end_opening()
            heard = replace(heard, called=(opening.sentence(),))
        return heard

    def _end_opening(self):
        self._opening = None
        if self.seen is not None:
            self.keep()

    def model(self, stamp):
        """The `PointingModel` by now, with all that is needed to come to it again.

        Parameters
        ----------
        stamp : int
            Of the newest observation, ns.
        """
        model, tracker = self._tracker.model(), self._tracker
        names = list(model.terms)
        walk = np.sqrt(np.diag(tracker.bank.mean_walk())[:len(names)])
        # the nights before are in it by now
        kept = {key: value for key, value in self._evening.provenance.items() if key != PAST}
        return replace(model, provenance={
            **kept, 'last_stamp_ns': stamp, KEY: {
                'stars': tracker.stars,
                'walk_arcsec_per_root_hour': dict(zip(names, (walk / ARCSEC).tolist())),
                'jumps_per_hour': sum(jump.per_hour for jump in tracker.bank.jumps),
                'evening': {
                    'model': self._document, 'stamp': self._began,
                    'zero_rad': self._first_zero.angles.tolist(), 'run': self._first_zero.run,
                    'encoder_start': self._first_zero.started, 'noise': list(self._noise),
                    'difference': self._difference, 'lean': self._lean,
                    'rates': self._rates}}})

    def bound_zero(self, name):
        """The zero that goes with the model of that name: all that is not known is in the model.

        Parameters
        ----------
        name : str
            Of `model_document.identity`.
        """
        return replace(self.zero, covariance=np.zeros((2, 2)), model=name)

    def document(self):
        """What was heard last and how well the mount is known, JSON-ready; angles in arcsec."""
        tracker = self._tracker
        # a ring at middle height stands for the sky
        az, el = np.arange(0.0, 2.0 * np.pi, np.pi / 4.0), np.full(8, np.pi / 4.0)
        expected = [tracker.expected(az, el, 60.0 * minutes) for minutes in (0.0, 10.0, 60.0)]
        return {
            'stars': tracker.stars, 'stamp': tracker.stamp,
            'expected_arcsec': {name: float(np.sqrt(np.mean(one.radial**2))) / ARCSEC
                                for name, one in zip(('now', '10 min', '1 h'), expected)},
            'chance_of_a_jump_in_1_h': expected[-1].jump, 'rates_arcsec_per_root_hour': {
                name: value / ARCSEC if name != 'who' else value
                for name, value in tracker.rates().items()},
            'confidence': tracker.confidence.verdict,
            'confidence_sentence': tracker.confidence.sentence(),
            'noise_factor': tracker.confidence.noise,
            'walk_factor': tracker.confidence.walk, 'notes': tracker.notes,
            'innovations': {'stars': len(self._nis), 'mean_square': (
                float(np.mean(self._nis)) / 2.0 if self._nis else None),
                'beyond_95': int(np.count_nonzero(np.array(self._nis) > _BEYOND)),
                'squares': [round(float(v), 4) for v in self._nis]},
            'events': self._events, **({'opening': self._opened} if self._opened else {}),
            'heard': [one.document() for one in self.heard]}

    def _tell(self, what, stamp, values):
        seen = Seen(what, stamp, values)
        if self.seen is not None:
            self.seen.append(seen)
        return self._tracker.take(seen)

    def _hear(self, heard):
        """Of a witness: what it makes known of the star before."""
        if heard.called:
            self.heard.append(heard)
            self._note(heard)

    def _note(self, heard):
        said = [*([heard.why] if heard.why else []), *heard.called,
                *([heard.confidence] if heard.confidence else [])]
        self._events = [*self._events, *({'stamp': heard.stamp, 'text': text}
                                         for text in said)][-MOST_EVENTS:]
        if heard.taken and heard.what == 'star' and heard.chances['nothing'] > 0.5:
            self._nis = [*self._nis, heard.nis][-MOST_NIS:]

    def _note_power_on(self, row, stamp):
        run = float(row['run'][0])
        if run == self.zero.run:
            return
        # from night to night they are switched on: that is in what is known of nights before
        if self._opening is None or self._opening.stars:
            self._tell('power_on', stamp, ((0, 1), BROAD))
            if self._opening is not None:
                self._end_opening()
        started = float(row['encoder_start'][0]) if 'encoder_start' in row else None
        self.zero = replace(self.zero, run=run, started=started)

    def _take_difference(self, row, stamp):
        if 'az_abs' not in row:
            return
        start = float(row['absolute_start'][0]) if 'absolute_start' in row else None
        if start != self._absolute_start:  # its zero is another one too
            self._tracker.reference.clear()
            self._absolute_start = start
        for axis, name in enumerate(('az', 'el')):
            apart = float(row[f'{name}_abs'][0] - row[f'{name}_enc'][0])
            if np.isfinite(apart):  # turns that one of them does not count are no matter
                first = self._difference['apart'][axis]
                self._hear(self._tell('difference', stamp, (
                    axis, first + float(wrap(apart - first)), self._difference['sigma'][axis])))

    def _offsets(self, row):
        x, y = PointingRun({**row.columns, **{
            f'{axis}_enc': row[f'{axis}_enc'] - angle
            for axis, angle in zip(('az', 'el'), self.zero.angles)}}, row.meta).offsets()
        return float(x[0]), float(y[0])


def _rounded(seconds):
    return int(np.rint(seconds * 1e9))


def difference_of(rows):
    """Absolute - incremental encoder as it stands, and how much one reading of it scatters.

    Parameters
    ----------
    rows : PointingRun
        In order.

    Returns
    -------
    dict or None
        ``apart`` and ``sigma`` of each axis, rad, and ``absolute_start``; of the newest
        power-on. None: too few readings, or no absolute encoder.
    """
    if 'az_abs' not in rows:
        return None
    own = rows.select(rows['run'] == rows['run'].max())
    start = float(own['absolute_start'][-1]) if 'absolute_start' in own else None
    if start is not None:
        own = own.select(own['absolute_start'] == start)
    out = {'apart': [], 'sigma': [], 'absolute_start': start}
    for name in ('az', 'el'):
        apart = own[f'{name}_abs'] - own[f'{name}_enc']
        apart = apart[np.isfinite(apart)]
        if len(apart) < _FEWEST:
            return None
        apart = apart[-1] + wrap(apart - apart[-1])
        out['apart'].append(float(np.median(apart[-_FEWEST:])))
        out['sigma'].append(float(1.4826 * np.median(np.abs(np.diff(apart))) / np.sqrt(2.0)))
    return out if min(out['sigma']) > 0.0 else None


def lean_of(rows):
    """What the base leans as it stands, and how much one reading of it scatters.

    Parameters
    ----------
    rows : PointingRun
        In order.

    Returns
    -------
    dict or None
        ``lean`` to the north and west and ``sigma``, rad. None: too few readings, or none.
    """
    if 'lean_north' not in rows:
        return None
    read = np.array([rows['lean_north'], rows['lean_west']])
    read = read[:, np.isfinite(read).all(axis=0)]
    if read.shape[1] < _FEWEST:
        return None
    sigma = float(1.4826 * np.median(np.abs(np.diff(read))) / np.sqrt(2.0))
    return {'lean': np.median(read[:, -_FEWEST:], axis=1).tolist(),
            'sigma': sigma} if sigma > 0.0 else None


def _noise_of(model):
    told = model.provenance.get('fitted_rms_arcsec')
    try:
        noise = float(told['x']) * ARCSEC, float(told['y']) * ARCSEC
    except (TypeError, KeyError, ValueError):
        return NOISE, NOISE
    return noise if min(noise) > 0.0 and np.isfinite(noise).all() else (NOISE, NOISE)
