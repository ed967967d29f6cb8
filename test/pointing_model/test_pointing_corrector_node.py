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

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)

from std_msgs.msg import String

from msg_tools import convert, topics
from msg_tools.homing import AxisHoming, homing_to_cloud
from msg_tools.units import ARCSEC, DEG
from pointing_model.calibration_messages import zero_identity, zero_to_joints
from pointing_model.effects import effect
from pointing_model.fitted_effects import FittedEffect
from pointing_model.harmonics import Harmonics
from pointing_model.model import PointingModel
from pointing_model.model_document import identity
from pointing_model.pointing_corrector_node import PointingCorrector
from pointing_model.pointing_terms import PHYSICAL
from pointing_model.zero import PowerOnZero

START = 1_768_482_000_000_000_000
MODEL = PointingModel(
    dict(zip(PHYSICAL, np.array([200, 100, 60, -90, 120, -130, 80]) * ARCSEC)),
    np.diag(np.arange(1.0, 8.0) * ARCSEC) ** 2)
ZERO, ZERO_SIGMA = np.array([33.0, -21.0]) * ARCSEC, np.array([2.0, 3.0]) * ARCSEC


class Desk:

    def __init__(self, graph, model=None, zero=None, **overrides):
        self.graph = graph
        self.model_pub, self.zero_pub, self.target_pub = (
            graph.publisher(topic) for topic in (topics.MODEL, topics.ZERO, topics.TARGET))
        self.demands = graph.listen(topics.DEMAND)
        self.sigmas = graph.listen(topics.DEMAND_SIGMA)
        # latched: both are there before the node is
        if model is not None:
            self.model_pub.publish(String(data=model.to_json()))
        if zero is not None:
            self.zero_pub.publish(convert.joint_state(
                START, zero, effort=ZERO_SIGMA, frame=''))
        self.node = graph.add(PointingCorrector, **overrides)
        graph.connect()
        if model is not None:
            graph.report('pointing_corrector', '', 'received /mount/model', 1)
        if zero is not None:
            graph.report('pointing_corrector', '', 'received /mount/zero', 1)

    def __call__(self, times, sky, rates):
        """Demands (n, 2), their rates (n, 2), and the sigma, for wanted directions."""
        before = len(self.demands)
        self.target_pub.publish(convert.trajectory(START, times, sky, rates))
        self.graph.wait_for(lambda: len(self.demands) > before and len(self.sigmas) > before)
        stamp, got, angles, velocities = convert.read_trajectory(self.demands[-1])
        assert stamp == START
        np.testing.assert_allclose(got, times)
        assert convert.from_stamp(self.sigmas[-1].header.stamp) == START
        return angles, velocities, np.array(
            [self.sigmas[-1].vector.x, self.sigmas[-1].vector.y])


TIMES = np.array([0.0, 20.0, 40.0])
RATES = np.array([[0.004, -0.002]] * 3) * DEG
SKY = np.array([200.0, 50.0]) * DEG + TIMES[:, None] * RATES


def test_without_model_and_zero_the_demand_is_the_direction(graph):
    desk = Desk(graph)
    angles, rates, sigma = desk(TIMES, SKY, RATES)
    np.testing.assert_allclose(angles, SKY, rtol=0, atol=1e-12)
    np.testing.assert_allclose(rates, RATES, rtol=0, atol=1e-12)
    assert not sigma.any()
    graph.report('pointing_corrector', 'no model yet: demands are the wanted directions')


def test_demand_is_model_plus_zero_applied_once(graph):
    desk = Desk(graph, MODEL, ZERO)
    angles, _, sigma = desk(TIMES, SKY, RATES)
    wanted = np.column_stack(MODEL.sky_to_encoder(*SKY.T)) + ZERO
    np.testing.assert_allclose(angles, wanted, rtol=0, atol=1e-11)
    sx, sy = (float(np.ravel(s)[0]) for s in MODEL.sigma(SKY[:1, 0], SKY[:1, 1]))
    zx, zy = ZERO_SIGMA * [np.cos(SKY[0, 1]), 1.0]
    np.testing.assert_allclose(sigma, [np.hypot(sx, zx), np.hypot(sy, zy)], rtol=1e-6)
    # the same question again has the same answer: nothing adds up
    np.testing.assert_array_equal(desk(TIMES, SKY, RATES)[0], angles)
    status = graph.report('pointing_corrector', 'ok', 'zero azimuth [arcsec]', '33.000')
    assert 'NPAE' in next(row.value for row in status.values if row.key == 'model')


def test_what_rests_on_undetermined_terms_has_no_sigma_and_is_told(graph):
    model = PointingModel({'IE': 1e-4, 'TF': 0.0}, undetermined=('IE', 'TF'),
                          directions=[{'TF': 1.0, 'IE': -np.cos(SKY[0, 1])}])
    desk = Desk(graph, model, ZERO)
    near, away = (desk(TIMES[:1], sky, RATES[:1])[2]
                  for sky in (SKY[:1], SKY[:1] + [0.0, 0.3]))
    assert np.isfinite(near).all() and np.isnan(away).all()
    graph.report('pointing_corrector', 'did not determine (IE, TF)')


@pytest.mark.parametrize('terms', [{}, MODEL.terms])
def test_harmonics_are_in_the_demand_and_in_its_sigma(graph, terms):
    rng = np.random.default_rng(1)
    model = PointingModel(terms, harmonics=Harmonics.from_degree(
        2, 'printed', rng.normal(size=14) * 10 * ARCSEC, np.eye(14) * ARCSEC**2))
    desk = Desk(graph, model, ZERO)
    angles, _, sigma = desk(TIMES, SKY, RATES)
    wanted = np.column_stack(model.sky_to_encoder(*SKY.T)) + ZERO
    np.testing.assert_allclose(angles, wanted, rtol=0, atol=1e-11)
    without = np.column_stack(PointingModel(terms).sky_to_encoder(*SKY.T)) + ZERO
    assert np.abs(angles - without).max() > 2 * ARCSEC
    assert (sigma > 1.0 * ARCSEC).all()
    status = graph.report('pointing_corrector', 'ok')
    assert 'harmonics(printed,2)' in next(r.value for r in status.values if r.key == 'model')


def test_a_new_zero_takes_the_place_of_the_old(graph):
    desk = Desk(graph, zero=ZERO)
    desk.zero_pub.publish(convert.joint_state(START, 2 * ZERO, frame=''))
    graph.report('pointing_corrector', '', 'received /mount/zero', 2)
    np.testing.assert_allclose(desk(TIMES, SKY, RATES)[0], SKY + 2 * ZERO, atol=1e-12)


def test_rates_are_those_of_the_demand(graph):
    desk = Desk(graph, MODEL, ZERO)
    # close to the zenith, where the model stretches the azimuth most
    rates = np.array([[0.05, 0.01]] * 2) * DEG
    times = np.array([0.0, 0.01])
    sky = np.array([80.0, 87.0]) * DEG + times[:, None] * rates
    angles, velocities, _ = desk(times, sky, rates)
    np.testing.assert_allclose(
        velocities[0], (angles[1] - angles[0]) / 0.01, rtol=0, atol=1e-4 * DEG)
    assert abs(velocities[0, 0] - rates[0, 0]) > 5e-4 * DEG  # the model does turn it


def test_azimuth_goes_on_across_north(graph):
    desk = Desk(graph, MODEL)
    az = np.array([359.9, 360.0, 0.1]) * DEG
    angles, rates, _ = desk(TIMES, np.column_stack([az, np.full(3, 0.9)]),
                            np.array([[0.005 * DEG, 0.0]] * 3))
    assert np.abs(np.diff(angles[:, 0])).max() < 0.2 * DEG
    np.testing.assert_allclose(rates[:, 0], 0.005 * DEG, rtol=0.01)


def test_bad_messages_are_refused_and_the_node_lives_on(graph):
    desk = Desk(graph, MODEL)
    good = convert.trajectory(START, TIMES, SKY, RATES)
    bad = [convert.trajectory(START, [], [], []),
           convert.trajectory(START, TIMES, SKY * np.nan, RATES),
           convert.trajectory(START, TIMES[::-1], SKY, RATES)]
    named = convert.trajectory(START, TIMES, SKY, RATES)
    named.joint_names = ['ra', 'dec']
    for message in [*bad, named]:
        desk.target_pub.publish(message)
    desk.model_pub.publish(String(data='{}'))
    desk.zero_pub.publish(convert.joint_state(START, [np.nan, np.nan]))
    graph.report('pointing_corrector', '6 messages refused')
    assert not desk.demands
    desk.target_pub.publish(good)
    graph.wait_for(lambda: desk.demands)
    np.testing.assert_allclose(
        convert.read_trajectory(desk.demands[0])[2],
        np.column_stack(MODEL.sky_to_encoder(*SKY.T)), rtol=0, atol=1e-11)


def test_a_zero_of_another_model_or_power_on_is_refused_and_the_pair_before_stays(graph):
    name = identity(MODEL.to_json())
    desk = Desk(graph, MODEL)
    encoder, identities = map(graph.publisher, (topics.HOMING, topics.ZERO_IDENTITY))
    graph.connect()

    def tell(started):
        axis = AxisHoming(True, 'below', 0, 1, np.nan, 1e-7, np.nan, 1, started)
        encoder.publish(homing_to_cloud([axis, axis], START))

    def set_zero(angles, **told):
        zero = PowerOnZero(*angles, run=1, **told)
        desk.zero_pub.publish(zero_to_joints(zero, START))
        identities.publish(zero_identity(zero, START))

    tell(1e9)
    graph.report('pointing_corrector', '', 'encoder', 'power-on 1 of 1000000000.000 s')
    set_zero(ZERO, started=1e9, model=name)
    graph.report('pointing_corrector', 'ok', 'model of the zero', name)
    wanted = desk(TIMES, SKY, RATES)[0]
    set_zero(9 * ZERO, started=1e9, model='none')
    graph.report('pointing_corrector', f'it is of model none, and {name} is active')
    np.testing.assert_array_equal(desk(TIMES, SKY, RATES)[0], wanted)
    set_zero(ZERO, started=1e9, model=name)
    tell(2e9)
    graph.report('pointing_corrector', 'the active zero is of the power-on that began at '
                 '1000000000.000')
    set_zero(7 * ZERO, started=1e9, model=name)
    graph.report('pointing_corrector', '', 'zeros of another power-on refused', 1)
    angles, _, sigma = desk(TIMES, SKY, RATES)
    np.testing.assert_array_equal(angles, wanted)
    assert np.isnan(sigma).all()  # nobody knows by how much the zero has moved
    set_zero(2 * ZERO, started=2e9, model=name)
    graph.report('pointing_corrector', '', 'zero azimuth [arcsec]', '66.000')
    assert np.isfinite(desk(TIMES, SKY, RATES)[2]).all()


def test_where_the_mount_cannot_point_it_gives_no_demand(graph):
    desk = Desk(graph, PointingModel({'CA': 600 * ARCSEC}))
    desk.target_pub.publish(convert.trajectory(START, [0.0], [[1.0, 89.99 * DEG]], [[0.0, 0.0]]))
    status = graph.report('pointing_corrector', '1 messages refused')
    assert any('too close to the zenith' in row.value for row in status.values)
    assert not desk.demands


def test_a_model_file_is_in_force_at_the_start(graph, tmp_path):
    MODEL.save(tmp_path / 'model.yaml')
    desk = Desk(graph, model_file=str(tmp_path / 'model.yaml'))
    np.testing.assert_allclose(desk(TIMES, SKY, RATES)[0],
                               np.column_stack(MODEL.sky_to_encoder(*SKY.T)), rtol=0, atol=1e-11)
    (tmp_path / 'bad.json').write_text('{"format": "other"}')
    with pytest.raises(ValueError, match='bad.json: not a pointing model'):
        graph.add(PointingCorrector, model_file=str(tmp_path / 'bad.json'))


def test_effects_act_where_their_driver_is_known_and_are_named_where_not(graph):
    effects = [
        FittedEffect(effect('drift', of='IE', driver='time', origin=START * 1e-9, scale=3600.0),
                     np.array([360.0]) * ARCSEC),
        FittedEffect(effect('drift', of='IE', driver='temperature', origin=10.0, scale=1.0),
                     np.array([3.0]) * ARCSEC),
        FittedEffect(effect('hysteresis', axis='az', shape='cosE'), np.array([8.0]) * ARCSEC)]
    desk = Desk(graph, model=PointingModel({'IA': 50 * ARCSEC}, effects=effects))
    angles, _, _ = desk(TIMES, SKY, RATES)
    # 0.1 arcsec a second; nobody has read a thermometer, nobody knows the approach
    np.testing.assert_allclose((angles[:, 1] - SKY[:, 1]) / ARCSEC, 0.1 * TIMES, atol=1e-3)
    np.testing.assert_allclose((angles[:, 0] - SKY[:, 0]) / ARCSEC, 50.0, atol=1e-6)
    status = graph.report('pointing_corrector', 'count as zero')
    assert 'flexure' not in status.message
    for name in ('elevation_zero_with_temperature', 'azimuth_hysteresis_cosE'):
        assert name in status.message
    assert 'with_time' not in status.message
    air = graph.publisher(topics.AMBIENT)
    graph.connect()
    air.publish(convert.temperature(START - 1, 12.0))
    graph.report('pointing_corrector', '', 'received /mount/ambient/temperature', 1)
    angles, _, _ = desk(TIMES, SKY, RATES)
    np.testing.assert_allclose((angles[:, 1] - SKY[:, 1]) / ARCSEC, 6.0 + 0.1 * TIMES, atol=1e-3)


def test_the_zero_follows_the_absolute_encoder_between_stars(graph):
    from pointing_model.zero_drift import KEY, AxisFollowing, Following
    follows = Following({'el': AxisFollowing(
        np.zeros(4), {1: 8.0 * ARCSEC}, 0.3 * ARCSEC, 0.4 * ARCSEC)})
    zero = PowerOnZero(*ZERO, np.diag(ZERO_SIGMA**2), 1)
    model = PointingModel(MODEL.terms, MODEL.covariance, provenance={
        KEY: follows.document(), 'zeros_in_force': [zero.to_dict()]})
    desk = Desk(graph, model)
    desk.zero_pub.publish(zero_to_joints(zero, START))
    graph.publisher(topics.ZERO_IDENTITY).publish(zero_identity(zero, START))
    graph.report('pointing_corrector', '', 'zero follows',
                 'no reading of both encoders yet: the zero stands still')
    still, _, sigma = desk(TIMES, SKY, RATES)
    np.testing.assert_allclose(sigma[1], np.hypot(
        MODEL.sigma(*SKY[:1].T)[1][0], np.hypot(3.0, 0.5) * ARCSEC), rtol=1e-6)
    # it hears both encoders from that model on
    pubs = [graph.publisher(topic) for topic in (topics.INCREMENTAL, topics.ABSOLUTE)]
    graph.connect()
    for moved in (0.0, 5.0):
        for k in range(3):
            stamp = START + 10**8 * (k + 10 * int(moved))
            for pub, reading in zip(pubs, ([1.0, 0.8 + (8.0 + moved) * ARCSEC], [0.9, 0.8])):
                pub.publish(convert.joint_state(stamp, reading))
        graph.report('pointing_corrector', '', 'zero follows',
                     f'absolute encoder: elevation by {moved:+.2f} arcsec')
    angles, _, _ = desk(TIMES, SKY, RATES)
    np.testing.assert_allclose((angles - still) / ARCSEC, [[0.0, 5.0]] * 3, atol=1e-4)
