"""The step `tell_apart`: stars that the calibration asks for, one after the other."""

from dataclasses import dataclass

import numpy as np

from msg_tools.units import DEG
from pointing_model.sky.star_catalogue import POLARIS_HIP, StarTarget

from .axis_demand import AxesAtRest
from .star_choice import axes_at, nearest_star

#: how far beyond a star an axis is sent that shall come to it from the other side, deg: more than a
#: play of a gear
BEYOND = 5.0
_HOUR = 3600e9  # ns


@dataclass
class DiscriminationStep:
    """Takes the stars that are asked for until nothing is asked any more.

    Attributes
    ----------
    outbox, exposer, table, instruments
        As of `NightSteps`.
    observe, until, diagnose, has_all : callable
        Steps that observe a target, wait for a condition (in words), have a model diagnosed, and
        wait for the calibration to take all rows.
    asked : callable
        Gives the last `Asked`, or None.
    say : callable
        Takes what is done, in words.
    stars, limits : callable
        Give the catalogue, and the `Limits` of the axes.
    refused : set of int
        Stars that the guard has refused.
    """

    outbox: object
    exposer: object
    table: object
    instruments: object
    observe: object
    until: object
    diagnose: object
    has_all: object
    asked: object
    say: object
    stars: object
    limits: object
    refused: set

    def steps(self, step):
        """Steps that do a `plan.Step`; what has come of it, in words."""
        taken, hours, tried = 0, step.hours, set()
        yield from self.has_all()
        if self.asked() is None or self.asked().stamp < self.table.newest:
            yield from self.diagnose()
        while True:
            yield from self.has_all()
            yield from self.until(self._is_told, 'the calibration to say what it asks for')
            if self.asked() is None:  # the calibration was started anew
                yield from self.diagnose()
                continue
            told = self.asked()
            wait = (told.request or {}).get('after_hours') or 0.0
            pair = bool(told.request and told.request.get('before'))
            if told.request is None or taken + pair >= step.count or wait > hours:
                break
            hours -= wait
            if wait:
                self.exposer.earliest = self.table.newest + round(wait * _HOUR)
            for request in filter(None, (told.request.get('before'), told.request)):
                rows = len(self.table)
                star, words = yield from self._come_to(request, told.request, tried)
                tried.add(star.number)
                self.say(words)
                taken += yield from self.observe(star, fresh=True)
                if len(self.table) == rows:
                    break  # it is asked again, with another star
        if taken:
            yield from self.diagnose()
        if wait > hours:
            return f'{told.says}; a star {wait:g} h later is wanted, {hours:g} h may be waited'
        return told.says + ('' if told.request is None else f'; {taken} stars were taken, no more')

    def _is_told(self):
        return self.asked() is None or self.asked().stamp >= self.table.newest

    def _come_to(self, request, whole, tried):
        """The star, with its axes where they come to it from the side that is asked for."""
        value, mount, place = self.outbox.value, self.outbox.mount(), np.zeros(2)
        now = max(self.exposer.now(), self.exposer.earliest)
        place[:] = request['az_deg'] * DEG, request['el_deg'] * DEG
        sides = int(request.get('approach_az') or 0), int(request.get('approach_el') or 0)
        here = np.array(self.instruments.here)
        short = request is whole and bool(whole.get('before'))
        row, off = nearest_star(
            self.stars(), now * 1e-9, *place, *self.outbox.sky(),
            min_el=value('min_elevation_deg') * DEG, max_el=value('max_elevation_deg') * DEG,
            mag_limit=value('magnitude_limit'), magnitude=request.get('magnitude'),
            exclude=[*tried, *self.refused, POLARIS_HIP], mount=mount, limits=self.limits(),
            # after a short move: nothing may come between
            **({'start': here, 'sides': sides} if short else {}))
        star = StarTarget(self.stars().select([row]))
        words = f'{star.name}, {off / DEG:.1f} deg from the place asked for, ' + (
            whole['why'] if request is whole else 'the one before ' + whole['why'])
        if not short and any(sides):
            az, el = star.place(np.array([now * 1e-9]), *self.outbox.sky())
            there = np.array([v[0] for v in axes_at(mount, az, el, self.limits(),
                                                    np.array([star.number]))])
            move = np.array([mount.way(here[0], there[0]), there[1] - here[1]])
            if np.any(np.array(sides) * move < 0.0):
                yield from self._beyond(here + move, np.where(sides, sides, np.sign(move)))
        return star, words

    def _beyond(self, there, sides):
        """Send the axes to where they come to a star from, and wait there for an exposure."""
        mount, value = self.outbox.mount(), self.outbox.value
        place = there - sides * BEYOND * DEG
        if mount.vertical:
            place[1] = np.clip(place[1], value('min_elevation_deg') * DEG,
                               value('max_elevation_deg') * DEG)
        # where the guard refuses it the star is taken as it comes: its row tells how
        yield from self.exposer.expose(AxesAtRest(place, mount))
