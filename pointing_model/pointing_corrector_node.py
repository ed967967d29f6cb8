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

"""The pointing corrector: turns wanted directions into encoder demands with their sigma."""

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from std_msgs.msg import String

from msg_tools import convert, topics
from msg_tools.node import MountNode
from msg_tools.power_on import PowerOns
from msg_tools.units import ARCSEC, wrap

from .active_calibration import correlated_sigma, time_driver, tracked_sigma
from .active_topics import MODEL_FILE, active_calibration_of
from .calibration_messages import pair_to_text
from .context import Context
from .encoder_difference import Difference
from .zero_drift import Following

PARAMS = (MODEL_FILE,)
#: half step of the difference that turns sky rates into encoder rates, s
STEP = 0.05


class PointingCorrector(MountNode):
    """Applies the latest model and zero, once, to the directions on `target`."""

    def __init__(self, **kwargs):
        super().__init__('pointing_corrector', PARAMS, hardware_id='pointing model', **kwargs)
        self._lacking, self._difference, self._open = (), None, False
        self._demand_pub = self.publisher(topics.DEMAND)
        self._sigma_pub = self.publisher(topics.DEMAND_SIGMA)
        self._pair_pub, self._pair_published = self.publisher(topics.ACTIVE), ''
        self._active = active_calibration_of(self, self._changed)
        self.subscribe(topics.TARGET, self._on_target)

    def _changed(self, topic):
        if topic is topics.MODEL:
            self._lacking, self._open = (), False
            self._follow()
        if self._active.bound:
            text = pair_to_text(self._active.model_text, self._active.zero_stamp,
                                self._active.zero)
            if text != self._pair_published:
                self._pair_published = text
                self._pair_pub.publish(String(data=text))

    def _follow(self):
        """Subscribe to both encoders as soon as a model has a zero that tracks the absolute one."""
        if not Following.from_model(self._active.model) or self._difference is not None:
            return
        self._difference = Difference()
        self.subscribe(topics.INCREMENTAL, lambda message: self._on_reading(
            self._difference.update_incremental, message))
        power_ons = PowerOns()
        self.subscribe(topics.ABSOLUTE_POWER_ON, power_ons.take)
        self.subscribe(topics.ABSOLUTE, lambda message: self._on_reading(
            self._difference.update_absolute, message,
            getattr(power_ons.of(message.header), 'started', np.nan)))

    def _on_reading(self, update, message, *start):
        stamp, angles = convert.read_joints(message)[:2]
        update(stamp, self._active.model.mount.on_travel(*angles), *start)
        if self._difference.incremental is not None:
            self._active.update_readings(self._active.zero.run, self._difference.incremental,
                                         self._difference.absolute, self._difference.start)

    def _drivers(self, stamps, sky):
        """Time and temperature; only the observer knows the star and the direction of approach."""
        model = self._active.model
        if model is None or not model.effects:
            return None
        return Context(sky[:, 0], sky[:, 1], {
            'time': time_driver(model, stamps),
            'temperature': self._active.thermometer.before(int(stamps[0]), np.nan)},
            mount=model.mount)

    def _encoder(self, sky, context):
        return self._active.encoder(sky[:, 0], sky[:, 1], context)

    def _on_target(self, message):
        names = self._names(message)
        stamp, times, sky, rates = convert.read_trajectory(message)
        context = self._drivers(stamp + np.rint(times * 1e9).astype(np.int64), sky)
        if context is not None:
            self._lacking = tuple(self._active.model.unknown(sky[:, 0], sky[:, 1], context))
        demand = self._encoder(sky, context)
        if not np.isfinite(demand).all():
            pole = 'zenith' if names == convert.AXES else 'pole of its first axis'
            raise ValueError(f'the mount cannot point there: too close to the {pole} for its '
                             'collimation and axes')
        ahead = self._encoder(sky + STEP * rates, context)
        behind = self._encoder(sky - STEP * rates, context)
        turn = ahead - behind
        turn[:, 0] = wrap(turn[:, 0])
        # the azimuth goes on from point to point, whatever turn the target is written in
        demand[:, 0] = np.unwrap(demand[:, 0])
        self._demand_pub.publish(
            convert.trajectory(stamp, times, demand, turn / (2.0 * STEP), names))
        model = self._active.model
        self._open = model is not None and bool(model.is_open(sky[:, 0], sky[:, 1]).any())
        self._sigma_pub.publish(convert.vector(
            stamp, *self._sigma(stamp, sky, context)))

    def _names(self, message):
        """Names of the joints of a target; ValueError if the model is of another mount."""
        found, model = convert.joints_of(message.joint_names), self._active.model
        if model is not None and found != model.mount.names.keys:
            raise ValueError(f'a target by {" and ".join(found)}, and the model is of a mount '
                             f'with {" and ".join(model.mount.names.keys)}')
        return found

    def _sigma(self, stamp, sky, context):
        """1 sigma of the demand on the sky at the first point, from model and zero, rad.

        Includes the possible drift of zero and terms since the model's rows.

        NaN if the zero is of another power-on (its shift is unknown), or if the prediction rests on
        terms that the stars of the fit did not determine.
        """
        if self._active.zero_is_unknown:
            return np.full(2, np.nan)
        out = np.zeros(2)
        model = self._active.model
        if model is not None:
            out = np.array([float(np.ravel(s)[0])
                            for s in model.sigma(sky[:, 0], sky[:, 1], context)])
        out = np.hypot(out, correlated_sigma(model, stamp, float(sky[0, 1])))
        out = np.hypot(out, tracked_sigma(model, stamp, *map(float, sky[0])))
        return np.hypot(out, self._active.zero_sigma * [float(np.cos(sky[0, 1])), 1.0])

    def problems(self):
        """What is missing for the correction, or makes it invalid."""
        found = [(DiagnosticStatus.WARN, text) for text in self._active.complaints()]
        if self._active.model is None:
            return [*found, (DiagnosticStatus.WARN, 'no model yet: demands are the wanted '
                             'directions' + (' plus the zero' if self._active.zero.angles.any()
                                             else ''))]
        if self._open:
            model = self._active.model
            names = (*model.undetermined, *model.undetermined_harmonics)
            found.append((DiagnosticStatus.WARN, 'the last demand rests on what the stars of the '
                          'fit did not determine'
                          + (f' ({", ".join(names)})' if names else
                             ' (no row on this side of the pier)') + ': how far it is off is not '
                          'known, demand_sigma is NaN'))
        if self._lacking:
            found.append((DiagnosticStatus.WARN, 'what drives these effects is not known here, '
                          f'they count as zero: {", ".join(self._lacking)}'))
        return found

    def details(self):
        """The active terms, model and zero."""
        terms, (model, zero) = 'none', (self._active.model, self._active.zero)
        if model is not None:
            series = [] if model.harmonics is None else [
                f'harmonics({model.harmonics.interpretation},{model.harmonics.degree})']
            terms = ' '.join([*model.terms, *series, *(e.effect.name for e in model.effects)])
        power_on = self._active.power_on
        return [('model', terms), ('model name', self._active.model_name),
                ('zero of power-on', 'none' if zero.run is None else str(int(zero.run))),
                ('model of the zero', zero.model or 'unknown'),
                ('zeros of another power-on refused', str(self._active.refused)),
                ('encoder', str(power_on) if power_on else 'power-on unknown'),
                ('zero azimuth [arcsec]', f'{zero.az / ARCSEC:.3f}'),
                ('zero elevation [arcsec]', f'{zero.el / ARCSEC:.3f}'),
                ('zero follows', self._active.following() or 'nothing')]
