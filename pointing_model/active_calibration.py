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

"""What is known of a pointing before it is made: the model and the zero that are active, and the
drivers of the model's effects.
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

#: an effect that follows the time holds for so long after the last row it was fitted to, ns
HORIZON = 12 * 3600 * 10**9


class Gauge:
    """Readings of a thermometer or an inclinometer, by their stamps."""

    def __init__(self):
        self._readings = deque(maxlen=1000)

    def update(self, stamp, value):
        """Keep a reading; one that is older than the last begins anew.

        Parameters
        ----------
        stamp : int
            ns.
        value : float or tuple
            degC; what the base leans to the north and to the west, rad.
        """
        if self._readings and stamp < self._readings[-1][0]:
            self._readings.clear()
        self._readings.append((stamp, value))

    def before(self, stamp, default):
        """The last reading made before `stamp` (ns); `default` without one."""
        return next((value for at, value in reversed(self._readings) if at < stamp), default)


def correlated_sigma(model, stamp, el):
    """How far the zero may have drifted since the rows of a model, on the sky.

    Parameters
    ----------
    model : PointingModel or None
        What drifts is in its provenance
        (`calibration.analysis.diagnosis.residual_correlation`).
    stamp : int
        ns.
    el : float
        Elevation, rad.

    Returns
    -------
    ndarray, shape (2,)
        1 sigma of x and y, radians, of each axis that drifts: what it has moved since the last
        row, 2 v (1 - exp(-t / tau)), and by then from the rows' middle, v (1 - exp(-T / 2 tau));
        0 where nothing is known to.

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
    """How far the terms of a tracked model may have moved since its last star, on the sky.

    Parameters
    ----------
    model : PointingModel or None
        Of a calibration in mode ``track``: its provenance gives how far each term drifts.
    stamp : int
        ns.
    az, el : float
        Place by the axes of the mount, rad.

    Returns
    -------
    ndarray, shape (2,)
        1 sigma of x and y, radians; 0 for a model that was not tracked. Without a jump.

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
    """Times at which the effects of a model may be asked that follow the time.

    Parameters
    ----------
    model : PointingModel
    stamps : ndarray of int, shape (n,)
        ns.

    Returns
    -------
    ndarray, shape (n,)
        UTC s; NaN more than `HORIZON` after the last row of the model, or as long before it: a
        drift goes on for the night, not for weeks.
    """
    stamps = np.asarray(stamps, dtype=np.int64)
    last = model.provenance.get('last_stamp_ns')
    time = stamps * 1e-9
    if isinstance(last, int) and not isinstance(last, bool):
        time = np.where(np.abs(stamps - last) <= HORIZON, time, np.nan)
    return time


def travelled(demand, row):
    """How the axes came to a pointing, for an effect that remembers the last one.

    Parameters
    ----------
    demand : array_like, shape (2,)
        Encoder angles, rad.
    row : dict or None
        The observation before, with the names of `run.COLUMNS`.

    Returns
    -------
    dict
        ``travel_az``, ``before_az``, ...; empty without a row before.
    """
    if row is None:
        return {}
    return {'travel_az': abs(float(wrap(demand[0] - row['az_enc']))),
            'travel_el': abs(float(demand[1] - row['el_enc'])),
            'before_az': row['approach_az'], 'before_el': row['approach_el']}


def pointing_context(model, stamps, az, el, known, *, zero, here, approach, row, site,
                     mount=ALTAZ):
    """What the effects of a model may ask of a pointing that is still to be made.

    Parameters
    ----------
    model : PointingModel
    stamps : ndarray of int, shape (n,)
        Of the track, ns.
    az, el : ndarray, shape (n,)
        Catalogue places, rad.
    known : dict
        Further drivers by the names of `run.COLUMNS`.
    zero : array_like, shape (2,)
        Active, rad.
    here : array_like, shape (2,)
        Where the encoders stand, rad.
    approach : array_like, shape (2,), or None
        Sign with which the axes came to this star, if they did; without it that of the move
        from `here`.
    row : dict or None
        The observation before.
    site : site.Site
    mount : Mount, optional
        Whose axes the angles are of.

    Returns
    -------
    Context
    """
    # which way the axes will come is known without the effects
    plain = np.ravel(replace(model, effects=()).sky_to_encoder(az[0], el[0])) + zero
    if approach is None:
        approach = np.sign([mount.way(here[0], plain[0]), plain[1] - here[1]])
    return Context(az, el, {
        **known, 'time': time_driver(model, stamps), 'approach_az': approach[0],
        'approach_el': approach[1], **travelled(plain, row)}, site.latitude, site.longitude,
        mount)


class ActiveCalibration:
    """Model, zero and thermometer, as they came last and as they go together.

    A zero that says which model it goes with is taken with that model alone: whichever of the two
    comes first waits for the other, and the pair before stays active. A zero of another power-on
    than the encoder is in is refused.

    Parameters
    ----------
    model : PointingModel, optional
        Active at the start.
    mount : Mount, optional
        A model of another one is refused; without it any is taken.

    Attributes
    ----------
    model : PointingModel or None
    models : int
        How many came into force.
    model_stamp : int
        Of the last observation that the model rests on, ns; 0 where it does not say.
    model_name, model_text : str
        `model_document.identity` of it, and its document; '' without one.
    zero : PowerOnZero
    zero_stamp : int
        Of the last observation that the zero rests on, ns.
    refused, refused_stamp : int
        How many zeros were refused; the same of the last of them.
    power_on : PowerOn or None
        That the encoder is in, where it tells.
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
        """Take a model as its JSON text; ValueError where it is none, or of another mount.

        Or where no mount has it: see `calibration_messages.check_model`.
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
        """Take a PowerOnZero, unless it is of another power-on than the encoder is in.

        Raises
        ------
        ValueError
            No encoder has it, see `calibration_messages.check_zero`; or it does not say what it is
            of, and the active one does.
        """
        check_zero(zero)
        if zero.run is None and None not in (self.zero.run, self.zero.started, self.zero.model):
            raise ValueError('a zero without its power-on and model (zero/identity), '
                             'beside an active one that has them')
        if self._mismatch(zero):
            # no error: right after a power cycle the last zero of before may still be on its way
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
        """Take what the encoder says of its power-on, a `PowerOn` or None."""
        self.power_on = power_on

    def _mismatch(self, zero):
        """How it is said that `zero` is not of the power-on that the encoder is in; '' if it is."""
        now = self.power_on
        if now is None or zero.started is None or zero.started == now.started:
            return ''
        return (f'is of the power-on that began at {zero.started:.3f}, and the encoder is in one '
                f'that began at {now.started:.3f}')

    @property
    def zero_is_unknown(self):
        """Whether the power-on that the encoder is in has a zero that is not the active one."""
        return bool(self._mismatch(self.zero)) or self.refused_stamp > self.zero_stamp

    @property
    def bound(self):
        """Whether the zero says that it goes with the model."""
        return self.zero.model == self.model_name

    def complaints(self):
        """What of model and zero cannot be gone by, sentences for people."""
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
        """Whether the zero is the one that the model tells of, if it tells.

        They come on two topics, and one without the other points elsewhere.
        """
        known = active_zeros(self.model)
        return not known or bool(np.all(
            np.abs(self.zero.angles - known.newest.angles) < 1e-6 * ARCSEC))

    # --- a zero that follows the absolute encoder -------------------------------------------------

    @property
    def follows(self):
        """Whether the zero follows the absolute encoder: the model says so, and it is its zero."""
        return bool(self._follows) and self.zero_is_of_model()

    def update_readings(self, run, incremental, absolute, start=np.nan):
        """Take what both encoders read at one moment, shape (2,) each, rad.

        `start` is when the absolute encoder's power-on began (UTC s; NaN where it does not tell).
        Of another one than the reference's nothing is taken: the zero stays at what it had
        followed to.
        """
        self._stopped = bool(self._follows.stopped(run, start)) if run is not None else False
        if np.isfinite([incremental, absolute]).all() and not self._stopped:
            self._difference = run, incremental, absolute

    @property
    def zero_now(self):
        """Azimuth and elevation, shape (2,), rad: the zero with what the counts have drifted."""
        if not self.follows or self._difference is None:
            return self.zero.angles
        return self.zero.angles + self._follows.moved(*self._difference)

    @property
    def zero_sigma(self):
        """1 sigma of `zero_now`, shape (2,), rad; 0 where it is not known."""
        sigma = np.nan_to_num(self.zero.sigma)
        return np.hypot(sigma, self._follows.sigma()) if self.follows else sigma

    def following(self):
        """What follows, for people; '' where nothing does."""
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
        """Encoder angles that point at a place: model and zero, each once.

        Parameters
        ----------
        az, el : ndarray, shape (n,)
            Catalogue place, rad.
        context : Context, optional
            What the effects of the model ask for.

        Returns
        -------
        ndarray, shape (n, 2)
            rad.
        """
        if self.model is None:
            return np.column_stack([az, el]) + self.zero_now
        context = as_context(context, az, el, self.model.mount)
        return np.column_stack(turned(self.model, context, self.zero_now))
