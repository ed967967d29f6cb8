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

"""Records the drivers of a running graph, and nudges the mount if allowed."""

import time

import numpy as np
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from std_srvs.srv import Trigger

from msg_tools import convert, topics
from msg_tools.power_on import PowerOns
from msg_tools.readiness import drives
from msg_tools.units import DEG
from pointing_model.sky.sky_params import SKY_PARAMS, site_of
from telescope_mount.guard.allowed_sky import AllowedSky

from ..running_graph.graph_client import GraphClient
from .contract import check_contract
from .guard_request import GuardClient
from .nudge import bright_star, check_nudge, fixed_place, place_of, went_elsewhere
from .samples import OK, WRONG, DriverSamples, Endpoint, Remark, Rest, Stream

DRIVER_TOPICS = topics.INCREMENTAL, topics.ABSOLUTE, topics.MISS_DISTANCE
#: nudge: seconds of a move, most seconds to come to rest, and seconds of the exposures at rest
RAMP, SETTLE, LOOK = 3.0, 20.0, 6.0
#: most s of a slew to a star
SLEW = 240.0
#: most s of `home`
HOMING = 300.0
#: distance from the demand at which a nudge counts as finished, rad
NEAR = 10.0 / 3600.0 * DEG


class Listener:
    """A node that records the instruments.

    Parameters
    ----------
    mount : Mount
    domain : int
    namespace : str
    guard : dict, optional
        Parameters of the guard that is started for nudging if none runs.
    params : Path, optional
        ROS parameter file of that guard.
    """

    def __init__(self, mount, domain, namespace, guard=None, params=None):
        self._mount, self._clock, self._first_tick = mount, None, None
        self._graph = GraphClient(domain, namespace, 'check_drivers', [
            '--ros-args', '--params-file', str(params)] if params else None)
        self._node = self._graph.node
        self._asking, self._guard = None, dict(guard or {})
        for topic in DRIVER_TOPICS:
            take = self._on_miss if topic is topics.MISS_DISTANCE else self._on_joints
            self._node.create_subscription(
                topic.message, topic.name,
                lambda message, take=take, name=topic.name: take(self._streams[name], message),
                topic.qos)
        self._power_ons = PowerOns()
        power_on = topics.INCREMENTAL_POWER_ON
        self._node.create_subscription(power_on.message, power_on.name, self._power_ons.take,
                                       power_on.qos)
        self._node.create_subscription(topics.CLOCK.message, topics.CLOCK.name, self._on_clock,
                                       topics.CLOCK.qos)
        self._forget()

    def _forget(self):
        self._streams = {topic.name: Stream(topic.name, topic.type) for topic in DRIVER_TOPICS}

    def spin(self, seconds, until=lambda: False):
        """Process messages so long, or until a condition holds; return whether it does."""
        return self._graph.spin_until(until, seconds)

    # --- messages -----------------------------------------------------------------------------

    def _now(self):
        return time.time() if self._clock is None else self._clock

    def _on_clock(self, message):
        self._clock = convert.from_stamp(message.clock) * 1e-9
        self._first_tick = self._first_tick or (time.monotonic(), self._clock)

    def _clock_speed(self):
        began, first = self._first_tick or (time.monotonic(), 0.0)
        wall = time.monotonic() - began
        return (self._clock - first) / wall if wall > 0.0 and self._first_tick else 1.0

    def _on_joints(self, stream, message):
        values = rates = (np.nan, np.nan)
        if set(self._mount.names.keys) <= set(message.name):
            try:
                _, values, rates, _ = convert.read_joints(message)
            except ValueError as err:
                stream.refused.append(str(err))
                return
        self._keep(stream, message.header, values, rates, message.name)

    def _on_miss(self, stream, message):
        self._keep(stream, message.header, convert.read_sky_vector(message))

    def _keep(self, stream, header, values, rates=(np.nan, np.nan), names=()):
        stream.frames.add(header.frame_id)
        stream.take(time.time(), convert.from_stamp(header.stamp) * 1e-9, values, rates, names,
                    self._power_ons.of(header), self._now())

    # --- the graph ----------------------------------------------------------------------------

    def samples(self, seconds):
        """A `DriverSamples` of what has been received so far."""
        node = self._node
        for topic in DRIVER_TOPICS:
            self._streams[topic.name].endpoints = [_endpoint(info) for info in
                node.get_publishers_info_by_topic(node.resolve_topic_name(topic.name))]
        tails = tuple('/' + name.rsplit('/', 1)[-1] for name in self._streams)
        ours = {node.resolve_topic_name(name) for name in self._streams}
        space = node.get_namespace().rstrip('/') + '/'
        return DriverSamples(
            self._mount, seconds, *self._streams.values(),
            services={name.removeprefix(space)
                      for name, _ in node.get_service_names_and_types()},
            followers=[_endpoint(info) for info in node.get_subscriptions_info_by_topic(
                node.resolve_topic_name(topics.COMMAND.name))
                if drives(info.node_name)],
            homing=bool(node.count_publishers(node.resolve_topic_name(topics.HOMING.name))),
            clock=self._clock is not None, clock_speed=self._clock_speed(),
            nowhere=self._graph.where_else(),
            elsewhere=[name for name, _ in node.get_topic_names_and_types()
                       if name.endswith(tails) and name not in ours])

    def listen(self, seconds):
        """A `DriverSamples` of the given time."""
        self.spin(seconds)
        return self.samples(seconds)

    def home(self, timeout=HOMING):
        """Call `home`.

        Returns
        -------
        Remark
        """
        client = self._node.create_client(Trigger, 'home')
        if not self.spin(5.0, client.service_is_ready):
            return Remark(WRONG, 'home', 'no such service')
        future = client.call_async(Trigger.Request())
        if not self.spin(timeout, future.done):
            return Remark(WRONG, 'home', f'has not answered for {timeout:g} s')
        answer = future.result()
        return Remark(OK if answer.success else WRONG, 'home', answer.message or 'no words')

    # --- nudging ------------------------------------------------------------------------------

    def nudge(self, step, star=False):
        """Move each axis by `step` (rad) and back, and record.

        Parameters
        ----------
        step : float
        star : bool
            Go to a bright star first, and follow it throughout.

        Returns
        -------
        samples : DriverSamples
            Readings minus the motion of the star.
        rests : list of Rest
        remarks : list of Remark
            Identifies the star.

        Raises
        ------
        ValueError
            Another node commands the mount, or its position is unknown.
        """
        self._asking = asking = GuardClient(self._node, self._graph.executor, self._mount,
                                            self.spin, self._guard)
        self._forget()
        if not self.spin(5.0, lambda: self._here() is not None):
            raise ValueError('not nudged: the encoder gives no number; call home first')
        home, place, remarks = self._here(), fixed_place(self._here()), []
        if star:
            site = _site(asking.status)
            target = bright_star(self._mount, site, self._now(), home,
                                 AllowedSky.from_rows(asking.status, site))
            place = place_of(target, self._mount, site, home)
            remarks = [Remark(
                OK, 'nudge', f'beside {target.name}, {target.magnitude:.1f} mag, from '
                f'{site.latitude / DEG:.4f}, {site.longitude / DEG:.4f} deg')]
            self._lead(place, np.zeros(2), 0.0, SLEW)
            home = self._here()
        # move away from horizon and zenith, or from either pole
        upward = 1.0 if np.sin(home[1]) < np.sin(0.25 * np.pi) else -1.0
        rests, begin = [], self._now()
        for offset in ((0.0, 0.0), (step, 0.0), (0.0, 0.0), (0.0, upward * step), (0.0, 0.0)):
            self._lead(place, offset, RAMP, SETTLE)
            since = self._now() + 1.0
            asking.obeyed(LOOK + 1.0)
            rests.append(Rest(since, self._now(), place([begin])[0] + offset))
        samples = self.samples(0.0)
        readings = samples.incremental
        readings.values = [tuple(value) for value in np.array(readings.values)
                           - (place(readings.stamps) - place([begin]))]
        return samples, rests, remarks

    def _lead(self, place, offset, ramp, patience):
        """Move the mount to an offset from a place and follow it, and wait until it does."""
        begin = self._now()
        times = ramp + np.arange(0.0, patience + LOOK + 15.0, 10.0)
        angles = place(begin + times) + offset
        rates = place(begin + times + 0.5) - place(begin + times - 0.5)
        if ramp:  # start from here, not by a path of the guard
            times, rates = np.append(0.0, times), np.vstack([rates[:1], rates])
            angles = np.vstack([self._here(), angles])
        asking, stamps = self._asking, self._streams[topics.INCREMENTAL.name].stamps
        here = self._here()
        asking.ask(round(begin * 1e9), times, angles, rates)
        try:
            asking.obeyed(ramp)
            asking.obeyed(patience, lambda: np.abs(
                self._here() - place(stamps[-1:])[0] - offset).max() < NEAR)
        except ValueError as err:
            raise ValueError(f'{err}{went_elsewhere(here, self._here(), self._mount)}') from None

    def _here(self):
        values = self._streams[topics.INCREMENTAL.name].values
        return np.array(values[-1]) if values and np.isfinite(values[-1]).all() else None

    def close(self):
        """Leave the graph."""
        if self._asking is not None:
            self._asking.close()
        self._graph.close()


def _site(rows):
    """The site in a guard's status."""
    missing = [param.name for param in SKY_PARAMS[:3] if param.name not in rows]
    if missing:
        raise ValueError(f'not nudged: the guard has no {missing[0]}: start it anew')
    return site_of(lambda name: float(rows[name]))


def _endpoint(info):
    return Endpoint(f'{info.node_namespace.rstrip("/")}/{info.node_name}', info.topic_type,
                    info.qos_profile.reliability != ReliabilityPolicy.BEST_EFFORT,
                    info.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL)


def check_drivers(mount, domain, namespace, seconds, step=0.0, home=False, guard=None,
                  params=None, star=False):
    """Call `home` if allowed, record, nudge if `step` (rad) is not 0, beside a `star`, and judge.

    For `mount`, `domain`, `namespace`, `guard` and `params` see `Listener`.

    Returns
    -------
    list of Remark
    """
    listener = Listener(mount, domain, namespace, guard, params)
    try:
        findings = [listener.home()] if home else []
        findings += check_contract(listener.listen(seconds))
        if not step:
            return findings
        # a driver in degrees would also take commands in degrees: fulfil the contract before moving
        if any(finding.level == WRONG for finding in findings):
            return [*findings, Remark(WRONG, 'nudge', 'not nudged: fix the errors above first')]
        try:
            samples, rests, remarks = listener.nudge(step, star)
        except ValueError as err:
            return [*findings, Remark(WRONG, 'nudge', str(err))]
        return [*findings, *remarks, *check_nudge(samples, rests, star)]
    finally:
        listener.close()
