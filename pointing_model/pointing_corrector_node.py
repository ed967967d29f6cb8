"""The pointing corrector: a wanted direction in, encoder demands and their sigma out."""

import sys

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus

from msg_tools import convert, topics
from msg_tools.node import MountNode, Param, run_node
from msg_tools.units import ARCSEC

from .context import Context
from .drivers import Thermometer, demand_angles, time_driver
from .model import PointingModel

PARAMS = (
    Param('model_file', '', 'pointing model in force at the start (JSON or YAML)', fixed=True),
)
#: step of the difference that turns sky rates into encoder rates, s
STEP = 0.05


class PointingCorrector(MountNode):
    """Applies the latest model and zero, once, to what is asked on `target`."""

    def __init__(self, **kwargs):
        super().__init__('pointing_corrector', PARAMS, hardware_id='pointing model', **kwargs)
        self._model = None
        if self.value('model_file'):
            self._model = PointingModel.load(self.value('model_file'))
        self._zero, self._zero_sigma = np.zeros(2), np.full(2, np.nan)
        self._thermometer = Thermometer()
        self._lacking = ()
        self._demand_pub = self.publisher(topics.DEMAND)
        self._sigma_pub = self.publisher(topics.DEMAND_SIGMA)
        self.subscribe(topics.MODEL, self._on_model)
        self.subscribe(topics.ZERO, self._on_zero)
        self.subscribe(topics.TARGET, self._on_target)
        self.subscribe(topics.AMBIENT, self._on_temperature)

    def _on_temperature(self, message):
        self._thermometer.take(*convert.read_temperature(message))

    def _on_model(self, message):
        self._model = PointingModel.from_json(message.data)
        self._lacking = ()

    def _on_zero(self, message):
        _, zero, _, sigma = convert.read_joints(message)
        if not np.isfinite(zero).all():
            raise ValueError('zero is not a number')
        self._zero, self._zero_sigma = np.array(zero), np.array(sigma)

    def _drivers(self, stamps, sky):
        """Time and temperature; how the axes will come, and the star, only the observer knows."""
        if self._model is None or not self._model.effects:
            return None
        return Context(sky[:, 0], sky[:, 1], {
            'time': time_driver(self._model, stamps),
            'temperature': self._thermometer.before(int(stamps[0]), np.nan)})

    def _encoder(self, sky, context):
        az, el = sky[:, 0], sky[:, 1]
        if self._model is not None:
            az, el = demand_angles(self._model, az, el, context, self._zero)
        return np.column_stack([az, el]) + self._zero

    def _on_target(self, message):
        stamp, times, sky, rates = convert.read_trajectory(message)
        context = self._drivers(stamp + np.rint(times * 1e9).astype(np.int64), sky)
        if context is not None:
            self._lacking = tuple(self._model.unknown(sky[:, 0], sky[:, 1], context))
        demand = self._encoder(sky, context)
        if not np.isfinite(demand).all():
            raise ValueError('the mount cannot point there: too close to the zenith for its '
                             'collimation and axes')
        ahead = self._encoder(sky + STEP * rates, context)
        behind = self._encoder(sky - STEP * rates, context)
        turn = ahead - behind
        turn[:, 0] = (turn[:, 0] + np.pi) % (2.0 * np.pi) - np.pi
        # the azimuth goes on from point to point, whatever turn the target is written in
        demand[:, 0] = np.unwrap(demand[:, 0])
        self._demand_pub.publish(
            convert.trajectory(stamp, times, demand, turn / (2.0 * STEP)))
        self._sigma_pub.publish(convert.vector(
            stamp, *self._sigma(sky, context), convert.MOUNT_FRAME))

    def _sigma(self, sky, context):
        """1-sigma of the demand on the sky at the first point, from model and zero, rad."""
        out = np.zeros(2)
        if self._model is not None:
            out = np.array([float(np.ravel(s)[0])
                            for s in self._model.sigma(sky[:, 0], sky[:, 1], context)])
        zero = self._zero_sigma * [float(np.cos(sky[0, 1])), 1.0]
        return np.hypot(out, np.where(np.isfinite(zero), zero, 0.0))

    def problems(self):
        """Nothing to correct with yet."""
        if self._model is None:
            return [(DiagnosticStatus.WARN, 'no model yet: demands are the wanted directions'
                     + (' plus the zero' if self._zero.any() else ''))]
        if self._lacking:
            return [(DiagnosticStatus.WARN, 'what drives these effects is not known here, they '
                     f'count as zero: {", ".join(self._lacking)}')]
        return []

    def details(self):
        """What is in force."""
        terms = 'none'
        if self._model is not None:
            terms = ' '.join([*self._model.terms, *(e.effect.name for e in self._model.effects)])
        return [('model', terms),
                ('zero azimuth [arcsec]', f'{self._zero[0] / ARCSEC:.3f}'),
                ('zero elevation [arcsec]', f'{self._zero[1] / ARCSEC:.3f}')]


def main(args=None):
    """Entry point of ``ros2 run telescope_mount pointing_corrector``."""
    sys.exit(run_node(PointingCorrector, args))


if __name__ == '__main__':
    main()
