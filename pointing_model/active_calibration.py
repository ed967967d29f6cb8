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

"""What is known before a pointing: the active model and zero, and the drivers of the model's
effects.
"""

from collections import deque
from dataclasses import replace

import numpy as np

from msg_tools.units import ARCSEC, wrap

from .calibration_messages import check_model, check_zero
from .context import Context
from .fitted_effects import as_context
from .model import PointingModel
from .model_application import turned
from .model_document import identity, walks_of
from .mounts import ALTAZ, mount_wording
from .pointing_terms import design
from .zero import NO_ZERO, active_zeros
from .zero_drift import AXES, Following

#: a time-dependent effect holds for this long after the last fitted row, ns
HORIZON = 12 * 3600 * 10**9


class Gauge:
    """Readings of a thermometer or an inclinometer, by their stamps."""

    def __init__(self):
        self._readings = deque(maxlen=1000)

    def update(self, stamp, value):
        """Add a reading; one older than the last clears the history.

        Parameters
        ----------
        stamp : int
            ns.
        value : float or tuple
            Temperature, degC; or tilt of the base to north and west, rad.
        """
        if self._readings and stamp < self._readings[-1][0]:
            self._readings.clear()
        self._readings.append((stamp, value))

    def before(self, stamp, default):
        """The last reading before `stamp` (ns); `default` if there is none."""
        return next((value for at, value in reversed(self._readings) if at < stamp), default)


def correlated_sigma(model, stamp, el):
    """Uncertainty from drift of the zero since the rows of a model, on the sky.

    Parameters
    ----------
    model : PointingModel or None
        Its provenance describes the drift
        (`calibration.analysis.diagnosis.residual_correlation`).
    stamp : int
        ns.
    el : float
        Elevation, rad.

    Returns
    -------
    ndarray, shape (2,)
        1 sigma of x and y, radians; 0 for an axis without known drift. The variance is the drift
        since the last row, 2 v (1 - exp(-t / tau)), plus that from the middle of the rows to the
        last, v (1 - exp(-T / 2 tau)).

    Raises
    ------
    ValueError
        That part of the model is damaged.
    """
    out = np.zeros(2)
    provenance = {} if model is None else model.provenance
    known, last = provenance.get('wander'), provenance.get('last_stamp_ns')
    if not isinstance(known, dict) or not isinstance(last, int):
        return out
    hours = max(stamp - last, 0) / 3600e9
    try:
        for k, axis in enumerate(AXES):
            one = known['axes'].get(axis)
            if one is None or one['unit'] != 'hours':
                continue
            share = -2.0 * np.expm1(-hours / one['memory']) - np.expm1(
                -0.5 * one['span'] / one['memory'])
            out[k] = one['sigma_arcsec'] * ARCSEC * np.sqrt(share) * (
                np.cos(el) if one['angle'] else 1.0)
    except (KeyError, TypeError, AttributeError):
        raise ValueError(f'drift of the model is damaged: {known!r:.60}') from None
    return out


def tracked_sigma(model, stamp, az, el):
    """Uncertainty from the random walk of a tracked model's terms since its last star, on the sky.

    Parameters
    ----------
    model : PointingModel or None
        From a calibration in mode ``track``: its provenance has the drift rate of each term.
    stamp : int
        ns.
    az, el : float
        Place by the axes of the mount, rad.

    Returns
    -------
    ndarray, shape (2,)
        1 sigma of x and y, radians; 0 for a model that was not tracked. Jumps are not included.

    Raises
    ------
    ValueError
        That part of the model is damaged.
    """
    walk = walks_of(model)
    last = None if walk is None else model.provenance.get('last_stamp_ns')
    if not isinstance(last, int):
        return np.zeros(2)
    hours = max(stamp - last, 0) / 3600e9
    x, y = design(tuple(model.terms), np.array([az]), np.array([el]), model.mount)
    return np.sqrt(hours * np.array([np.sum((columns[0] * walk)**2) for columns in (x, y)]))


def time_driver(model, stamps):
    """Times for the time-dependent effects of a model.

    Parameters
    ----------
    model : PointingModel
    stamps : ndarray of int, shape (n,)
        ns.

    Returns
    -------
    ndarray, shape (n,)
        UTC s. NaN more than `HORIZON` after or before the last row of the model: a drift may be
        extrapolated over a night, not over weeks.
    """
    stamps = np.asarray(stamps, dtype=np.int64)
    last = model.provenance.get('last_stamp_ns')
    time = stamps * 1e-9
    if isinstance(last, int) and not isinstance(last, bool):
        time = np.where(np.abs(stamps - last) <= HORIZON, time, np.nan)
    return time


def travelled(demand, row):
    """Drivers of how the axes reach a pointing, for effects that depend on the last one.

    Parameters
    ----------
    demand : array_like, shape (2,)
        Encoder angles, rad.
    row : dict or None
        The previous observation, with the names of `run.COLUMNS`.

    Returns
    -------
    dict
        ``travel_az``, ``before_az``, ...; empty without a previous row.
    """
    if row is None:
        return {}
    return {'travel_az': abs(float(wrap(demand[0] - row['az_enc']))),
            'travel_el': abs(float(demand[1] - row['el_enc'])),
            'before_az': row['approach_az'], 'before_el': row['approach_el']}


def pointing_context(model, stamps, az, el, known, *, zero, here, approach, row, site,
                     mount=ALTAZ):
    """Drivers of the model's effects for a pointing that is still to be made.

    Parameters
    ----------
    model : PointingModel
    stamps : ndarray of int, shape (n,)
        Stamps of the track, ns.
    az, el : ndarray, shape (n,)
        Catalogue places, rad.
    known : dict
        Further drivers by the names of `run.COLUMNS`.
    zero : array_like, shape (2,)
        Active zero, rad.
    here : array_like, shape (2,)
        Current encoder angles, rad.
    approach : array_like, shape (2,), or None
        Sign of the final approach of the axes to this star, if known; otherwise that of the
        move from `here`.
    row : dict or None
        The previous observation.
    site : site.Site
    mount : Mount, optional
        Its axes define the angles.

    Returns
    -------
    Context
    """
    # the direction of approach does not need the effects
    plain = np.ravel(replace(model, effects=()).sky_to_encoder(az[0], el[0])) + zero
    if approach is None:
        approach = np.sign([mount.way(here[0], plain[0]), plain[1] - here[1]])
    return Context(az, el, {
        **known, 'time': time_driver(model, stamps), 'approach_az': approach[0],
        'approach_el': approach[1], **travelled(plain, row)}, site.latitude, site.longitude,
        mount)


class ActiveCalibration:
    """The latest consistent set of model, zero and thermometer.

    A zero that names its model is only used together with that model: whichever comes first waits
    for the other, and the previous pair stays active. A zero is refused if it belongs to another
    power-on than the present one of the encoder.

    Parameters
    ----------
    model : PointingModel, optional
        Model that is active at the start.
    mount : Mount, optional
        A model of another mount is refused; by default any is accepted.

    Attributes
    ----------
    model : PointingModel or None
    models : int
        Number of models that became active.
    model_stamp : int
        Stamp of the last observation of the fit, ns; 0 if unknown.
    model_name, model_text : str
        `model_document.identity` of the model, and its document; '' without a model.
    zero : PowerOnZero
    zero_stamp : int
        Stamp of the last observation used for the zero, ns.
    refused, refused_stamp : int
        Number of refused zeros, and the stamp of the last of them.
    power_on : PowerOn or None
        Present power-on of the encoder, if it reports one.
    thermometer : Thermometer
    """

    def __init__(self, model=None, mount=None):
        self._mount = mount
        self.model, self.model_text = model, model.to_json() if model else ''
        self.model_name = identity(self.model_text)
        self.models = self.model_stamp = 0
        self.zero, self.zero_stamp = NO_ZERO, 0
        self.refused = self.refused_stamp = 0
        self.power_on = None
        self._follows, self._difference, self._stopped = Following.from_model(model), None, False
        self.thermometer, self.inclinometer = Gauge(), Gauge()
        self._next_model = self._next_zero = None  # each waits for the other

    def update_model(self, text):
        """Take a model as JSON text.

        ValueError if it is not a model, is of another mount, or fails
        `calibration_messages.check_model`.
        """
        model, name = PointingModel.from_json(text), identity(text)
        check_model(model)
        if self._mount is not None and not self._mount.agrees(model.mount):
            raise ValueError(f'a model of another mount ({mount_wording(model.mount)}) than this '
                             f'one ({mount_wording(self._mount)})')
        waiting = self._next_zero
        if waiting is not None and waiting[1].model == name:
            self._activate(model, name, text)
            self.zero_stamp, self.zero = waiting
        elif self.zero.model in (None, name):
            self._activate(model, name, text)
        else:
            self._next_model = model, name, text

    def _activate(self, model, name, text):
        self.model, self.model_name, self.model_text = model, name, text
        self._follows, self._stopped = Following.from_model(model), False
        self.models += 1
        stamp = model.provenance.get('last_stamp_ns')
        self.model_stamp = stamp if isinstance(stamp, int) else 0
        self._next_model = self._next_zero = None

    def update_zero(self, stamp, zero):
        """Take a PowerOnZero, unless it belongs to another power-on of the encoder.

        Raises
        ------
        ValueError
            `calibration_messages.check_zero` fails; or the zero lacks its power-on and model while
            the active one has them.
        """
        check_zero(zero)
        if zero.run is None and None not in (self.zero.run, self.zero.started, self.zero.model):
            raise ValueError('a zero without its power-on and model (zero/identity), '
                             'beside an active one that has them')
        if self._mismatch(zero):
            # not an error: after a power cycle a zero of the previous power-on may still arrive
            self.refused += 1
            self.refused_stamp = max(self.refused_stamp, stamp)
            return
        if zero.model not in (None, self.model_name):
            if self._next_model is None or self._next_model[1] != zero.model:
                self._next_zero = stamp, zero
                return
            self._activate(*self._next_model)
        self.zero, self.zero_stamp, self._next_zero = zero, stamp, None

    def update_power_on(self, power_on):
        """Take the power-on that the encoder reports, a `PowerOn` or None."""
        self.power_on = power_on

    def _mismatch(self, zero):
        """Message that `zero` is not of the present power-on; '' if it is."""
        now = self.power_on
        if now is None or zero.started is None or zero.started == now.started:
            return ''
        return (f'is of the power-on that began at {zero.started:.3f}, and the encoder is in one '
                f'that began at {now.started:.3f}')

    @property
    def zero_is_unknown(self):
        """Whether the active zero is of another power-on, or a newer zero was refused."""
        return bool(self._mismatch(self.zero)) or self.refused_stamp > self.zero_stamp

    @property
    def bound(self):
        """Whether the zero names the active model as its own."""
        return self.zero.model == self.model_name

    def complaints(self):
        """Problems of model and zero, sentences for people."""
        out = []
        wrong = self._mismatch(self.zero)
        if wrong:
            out.append(f'the active zero {wrong}: set it anew (calibrate_zero)')
        elif self.refused_stamp > self.zero_stamp:
            out.append('the last zero was not taken, it is of another power-on: set it anew '
                       '(calibrate_zero)')
        if self._next_zero is not None:
            out.append(f'a zero was not taken: it is of model {self._next_zero[1].model}, and '
                       f'{self.model_name} is active')
        if self._next_model is not None:
            out.append(f'model {self._next_model[1]} was not taken: its zero has not come, and '
                       f'the active one is of {self.zero.model}')
        if self.follows and self._stopped:
            out.append('the zero no longer follows the absolute encoder, which was switched off '
                       'and on since the reference: set it anew (calibrate_zero) and fit')
        return out

    def zero_is_of_model(self):
        """Whether the zero is the one recorded in the model, if any is recorded.

        They come on two topics; one without the other gives a wrong pointing.
        """
        known = active_zeros(self.model)
        return not known or bool(np.all(
            np.abs(self.zero.angles - known.newest.angles) < 1e-6 * ARCSEC))

    # --- a zero that follows the absolute encoder -------------------------------------------------

    @property
    def follows(self):
        """Whether the zero tracks the absolute encoder: its model says so, and it is its zero."""
        return bool(self._follows) and self.zero_is_of_model()

    def update_readings(self, run, incremental, absolute, start=np.nan):
        """Take simultaneous readings of both encoders, shape (2,) each, rad.

        `start` is when the present power-on of the absolute encoder began (UTC s; NaN if it is not
        reported). After a power cycle since the reference the readings are ignored: the zero keeps
        its last tracked value.
        """
        self._stopped = bool(self._follows.stopped(run, start)) if run is not None else False
        if np.isfinite([incremental, absolute]).all() and not self._stopped:
            self._difference = run, incremental, absolute

    @property
    def zero_now(self):
        """Zero in azimuth and elevation, shape (2,), rad: with the drift of the counts added."""
        if not self.follows or self._difference is None:
            return self.zero.angles
        return self.zero.angles + self._follows.moved(*self._difference)

    @property
    def zero_sigma(self):
        """1 sigma of `zero_now`, shape (2,), rad; 0 where unknown."""
        sigma = np.nan_to_num(self.zero.sigma)
        return np.hypot(sigma, self._follows.sigma()) if self.follows else sigma

    def following(self):
        """What tracks the absolute encoder, for people; '' if nothing does."""
        if not self.follows:
            return ''
        stopped = 'stopped, it was switched off and on: ' if self._stopped else ''
        if self._difference is None:
            return (f'{stopped}the zero stands still' if stopped else
                    'no reading of both encoders yet: the zero stands still')
        moved = dict(zip(AXES, self.zero_now - self.zero.angles))
        axes = dict(zip(AXES, self.model.mount.names.axes))
        return f'absolute encoder: {stopped}' + ', '.join(
            f'{axes[name]} by {moved[name] / ARCSEC:+.2f} arcsec' for name in self._follows.axes)

    def encoder(self, az, el, context=None):
        """Encoder angles that point at a place, with model and zero each applied once.

        Parameters
        ----------
        az, el : ndarray, shape (n,)
            Catalogue place, rad.
        context : Context, optional
            Drivers of the model's effects.

        Returns
        -------
        ndarray, shape (n, 2)
            rad.
        """
        if self.model is None:
            return np.column_stack([az, el]) + self.zero_now
        context = as_context(context, az, el, self.model.mount)
        return np.column_stack(turned(self.model, context, self.zero_now))
