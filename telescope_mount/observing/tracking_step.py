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

"""The step `track`: keep the expected error of a model below a goal, with few stars."""

from types import SimpleNamespace

import numpy as np

from msg_tools.steps import CallRefused
from msg_tools.units import ARCSEC, DEG
from pointing_model.model_document import KEY, walks_of
from pointing_model.pointing_terms import design
from pointing_model.rms import rms

from .tracking_star import SlewTime, error_over, next_star, until

#: number of candidate stars, and time per star besides slew and exposure, s
CANDIDATES, EXPOSURE = 40, 10.0
#: longest wait for a star, s: a jump shows only with a star
LONGEST_WAIT = 1800.0
#: the error is kept below this fraction of the goal, since the next star takes time, too
RESERVE = 0.9
_MINUTE = 60_000_000_000  # ns


def hold_error(night, step):
    """Steps that observe the most useful star whenever the expected error requires it.

    Parameters
    ----------
    night : NightSteps
    step : plan.PlanStep

    Returns
    -------
    str
        The outcome.
    """
    exposer, table, active = night.exposer, night.table, night.active

    def tracked():
        return active.model is not None and KEY in active.model.provenance

    end, before = exposer.now() + step.count * _MINUTE, len(table)
    if active.model is not None and not tracked():
        yield from night.observe_fresh(1)  # starts the tracking of a fitted model
    while True:
        yield from night.calibration_has_all()
        newest = table.newest
        if tracked():
            yield from night.until(lambda newest=newest: active.model_stamp >= newest,
                                   'the tracked model')
        try:
            model = TrackedModel(active.model)
        except ValueError as err:
            raise CallRefused(str(err)) from None
        stars = night.fresh_stars(CANDIDATES, again=True)
        places = _places(night, stars)
        due = model.stamp + round(until(model, places, RESERVE * step.goal, LONGEST_WAIT) * 1e9)
        exposer.earliest = max(due, exposer.now())
        if exposer.earliest >= end:
            expected = error_over(model, places, (end - model.stamp) * 1e-9) / ARCSEC
            return (f'{len(table) - before} stars in {step.count:.0f} minutes; expected error at '
                    f'the end {expected:.2f} arcsec, goal {step.goal / ARCSEC:g}')
        waited = (exposer.earliest - model.stamp) * 1e-9
        rate = night.out.value('slew_rate_deg_s') * DEG
        chosen = next_star(model, *places, night.instruments.here, places, waited,
                           sigma=model.noise, slew=SlewTime((rate, rate)),
                           exposure_s=EXPOSURE + night.out.value('exposure_s'))
        star = stars[chosen.row]
        night.announce(f'{star.name}: {chosen.sentence()}')
        yield from night.observe(star, fresh=True)


def _places(night, stars):
    """Axis angles of stars, rad, shape (2, n)."""
    now, mount = np.array([night.exposer.now() * 1e-9]), night.out.mount()
    return np.array([mount.axes_of(*(v[0] for v in star.place(now, *night.out.sky())))
                     for star in stars]).T


class TrackedModel:
    """The filter interface needed by `next_star`, from the published model.

    Parameters
    ----------
    model : PointingModel
        From a calibration in mode ``track``.

    Attributes
    ----------
    mount : Mount
    states : tuple of str
        The terms.
    noise : float
        1 sigma of a star along x or y, rad.
    stamp : int
        Stamp of the last star, ns.

    Raises
    ------
    ValueError
        Not a tracked model, or damaged.
    """

    def __init__(self, model):
        walks = walks_of(model)
        if walks is None:
            raise ValueError('no tracked model: set the calibration to mode track, and give it a '
                             'first model (fit, or --reference)')
        try:
            noise = model.provenance[KEY]['evening']['noise']
            self.noise = rms(noise)
            self.stamp = int(model.provenance['last_stamp_ns'])
        except (KeyError, TypeError, ValueError) as err:
            raise ValueError(f'tracking record of the model is damaged: {err}') from None
        self.mount, self.states = model.mount, tuple(model.terms)
        self._covariance, self._walk = np.asarray(model.covariance), np.square(walks)

    def columns(self, az, el):
        """Design columns of the terms at axis angles, shape (p, 2, k)."""
        return np.stack(design(self.states, az, el, self.mount), axis=1)

    def ahead(self, seconds):
        """Covariance of the terms this long after the last star, shape (k, k)."""
        return self._covariance + np.diag(self._walk * seconds / 3600.0)

    def expected(self, az, el, seconds_ahead=0.0):
        """Expected error at places, in the attribute ``radial``, rad, shape (p,)."""
        columns = self.columns(np.atleast_1d(az), np.atleast_1d(el))
        return SimpleNamespace(radial=np.sqrt(np.einsum(
            'pij,jk,pik->p', columns, self.ahead(seconds_ahead), columns)))
