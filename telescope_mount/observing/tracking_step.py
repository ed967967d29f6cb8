"""The step `track`: the expected error of a model is held below a goal, with few stars."""

from dataclasses import dataclass

import numpy as np

from msg_tools.steps import CallRefused
from msg_tools.units import ARCSEC, DEG
from pointing_model.term_drift import KEY

from .track_choice import TrackedModel, choose_next, next_time

#: stars among which it chooses, and what a star takes beside its slew and exposure, s
CANDIDATES, EXPOSURE = 40, 10.0
_MINUTE = 60_000_000_000  # ns


@dataclass
class Holding:
    """Takes the star that helps most, when the expected error asks for one.

    Attributes
    ----------
    outbox, exposer, in_force, table, instruments
        As of `NightSteps`.
    fresh_stars : callable
        ``fresh_stars(count)``: stars that may be taken.
    observe, observe_any, until, has_all : callable
        Steps that observe a star, or any star; wait for a condition (in words); and wait for the
        calibration to take all rows.
    say : callable
        Takes what is done, in words.
    """

    outbox: object
    exposer: object
    in_force: object
    table: object
    instruments: object
    fresh_stars: object
    observe: object
    observe_any: object
    until: object
    has_all: object
    say: object

    def steps(self, step):
        """Steps that do a `plan.Step`; what has come of it, in words."""
        end, before = self.exposer.now() + step.count * _MINUTE, len(self.table)
        if self._model is not None and KEY not in self._model.provenance:
            yield from self.observe_any()  # with it a model that was fitted is tracked
        while True:
            yield from self.has_all()
            newest = self.table.newest
            if self._model is not None and KEY in self._model.provenance:
                yield from self.until(lambda newest=newest: self.in_force.model_stamp >= newest,
                                      'the tracked model')
            try:
                model = TrackedModel(self._model)
            except ValueError as err:
                raise CallRefused(str(err)) from None
            stars = self.fresh_stars(CANDIDATES)
            places = self._places(stars)
            due = model.stamp + round(next_time(model, step.goal, *places) * 1e9)
            self.exposer.earliest = max(due, self.exposer.now())
            if self.exposer.earliest >= end:
                expected = model.expected(*places, (end - model.stamp) * 1e-9).radial
                return (f'{len(self.table) - before} stars in {step.count:.0f} minutes held the '
                        'expected error; it is '
                        f'{np.sqrt(np.mean(expected**2)) / ARCSEC:.2f} arcsec at the end, of '
                        f'{step.goal / ARCSEC:g}')
            waited = (self.exposer.earliest - model.stamp) * 1e-9
            chosen = choose_next(model, *places, self.instruments.here,
                                 EXPOSURE + self.outbox.value('exposure_s'), waited,
                                 self.outbox.value('slew_rate_deg_s') * DEG)
            star = stars[chosen.row]
            self.say(f'{star.name}: {chosen.sentence()}')
            yield from self.observe(star)

    @property
    def _model(self):
        return self.in_force.model

    def _places(self, stars):
        """By the axes, rad, shape (2, n)."""
        now, sky, mount = np.array([self.exposer.now() * 1e-9]), self.outbox.sky(), \
            self.outbox.mount()
        return np.array([mount.axes_of(*(v[0] for v in star.place(now, *sky)))
                         for star in stars]).T
