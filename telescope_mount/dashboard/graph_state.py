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

"""The state of a graph from the messages received last, live or from a log.

Needs no ROS: messages from a log have the same fields.
"""

from dataclasses import asdict, dataclass, field

import numpy as np

from msg_tools import NAMESPACE, convert, topics
from msg_tools.bag.losses import utc
from msg_tools.power_on import PowerOns
from msg_tools.status_rows import Progress
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.calibration_messages import ZeroPairs, text_to_pair
from pointing_model.model import PointingModel
from pointing_model.mounts import ALTAZ
from pointing_model.runs.run import PointingRun
from pointing_model.runs.run_messages import cloud_to_run

from .reported_problems import alarms

#: topics of which the last message is kept
LAST = (topics.REQUEST, topics.GUARD_STATUS, topics.INCREMENTAL, topics.ABSOLUTE,
        topics.MISS_DISTANCE, topics.AMBIENT, topics.OBSERVATIONS, topics.OBSERVER_STATUS,
        topics.ZERO, topics.ZERO_IDENTITY, topics.INCREMENTAL_POWER_ON, topics.ACTIVE,
        topics.CALIBRATION_STATUS, topics.CALIBRATION_REPORT)
#: all subscribed topics
SUBSCRIBED = (*LAST, topics.CLOCK, topics.OBSERVATION, topics.DIAGNOSTICS)
#: largest time between readings of the two encoders that are compared, using their rates, s
LARGEST_DELAY = 0.5
#: s without a report until a node counts as silent; nodes report once a second
SILENT = 5.0
#: most stars drawn
STARS = 500


#: columns of the last stars: UTC, s since 1970; power-on of the incremental encoder, 0 if the row
#: has none; place on the sky, azimuth from north through east; encoder - catalogue on the sky, as
#: read, and residual from the active zero and model, NaN for stars of another power-on;
#: incremental - absolute encoder
STAR_COLUMNS = ('time_s', 'power_on', 'az_deg', 'el_deg', 'offset_x_arcsec', 'offset_y_arcsec',
                'left_x_arcsec', 'left_y_arcsec', 'encoders_first_arcsec',
                'encoders_second_arcsec')


@dataclass
class WatchState:
    """State of a graph; None if unknown. Pairs are for the first and the second axis.

    Attributes
    ----------
    source : str
        The graph, or the log.
    time_utc : str or None
        Time of the newest message, ISO 8601.
    joints : tuple of str
    reading_deg, rate_deg_s, wanted_deg : list of float or None
        Readings and rates of the incremental encoder; requested angles at the time of the reading.
    looks_at_deg, sent_to_deg : list of float or None
        Azimuth and elevation on the sky of the readings and the requested angles.
    power_on : int or None
        Power-on of the incremental encoder.
    zero_arcsec, zero_sigma_arcsec : list of float or None
    zero_power_on : int or None
        Power-on for which the zero is valid.
    zero_by : str or None
        How the zero was determined.
    encoders_arcsec : list of float or None
        Incremental - absolute encoder.
    miss_arcsec : list of float or None
        The last miss distance.
    temperature_c : float or None
    plan : dict
        The rows of `Progress`; empty without an observer.
    messages : dict of str to str
        Messages of ``observer``, ``guard`` and ``calibration``.
    guard : str or None
        State of the guard.
    left_by : str
        What residuals are relative to: ``zero and model``, ``zero``, or '' if nothing is active.
    stars : dict of str to list of float
        Last stars by `STAR_COLUMNS`, the newest last.
    nodes : dict of str to dict
        By name, ``level`` (ok, warning, error, silent) and ``said``.
    alarms : list of dict
        ``level`` and ``said``, the worst first.
    """

    source: str
    time_utc: str | None = None
    joints: tuple = convert.AXES
    reading_deg: list | None = None
    rate_deg_s: list | None = None
    wanted_deg: list | None = None
    looks_at_deg: list | None = None
    sent_to_deg: list | None = None
    power_on: int | None = None
    zero_arcsec: list | None = None
    zero_sigma_arcsec: list | None = None
    zero_power_on: int | None = None
    zero_by: str | None = None
    encoders_arcsec: list | None = None
    miss_arcsec: list | None = None
    temperature_c: float | None = None
    plan: dict = field(default_factory=dict)
    messages: dict = field(default_factory=dict)
    guard: str | None = None
    left_by: str = ''
    stars: dict = field(default_factory=lambda: {name: [] for name in STAR_COLUMNS})
    nodes: dict = field(default_factory=dict)
    alarms: list = field(default_factory=list)

    def document(self):
        """The state for JSON, dict."""
        return asdict(self)


class LastMessages:
    """Collects messages and returns the state.

    Parameters
    ----------
    source : str
        Name of the source in the state.
    namespace : str
        Namespace of the graph; reports of other nodes are ignored.
    """

    def __init__(self, source, namespace=NAMESPACE):
        self._source, self._within = source, f'{namespace.rstrip("/")}/'
        self.last = {}
        self._newest = self._clock = 0
        self._nodes = {}  # name -> status, time of reception (s) or None
        self._rows, self._bad = [], {}

    @property
    def any(self):
        """Whether any message of the graph was received; those without a namespace do not count."""
        return bool(self.last or self._nodes)

    def take(self, name, message, ns=0, arrived=None):
        """Process a message.

        Parameters
        ----------
        name : str
            Name of its topic, as in `msg_tools.topics`.
        message : object
        ns : int
            Its time in a log; by default that of its stamp.
        arrived : float, optional
            Monotonic time of reception, s; None in a log: then no node counts as silent.
        """
        if name == topics.CLOCK.name:
            self._clock = convert.from_stamp(message.clock)
            return
        stamp = getattr(getattr(message, 'header', None), 'stamp', None)
        self._newest = max(self._newest, ns or (convert.from_stamp(stamp) if stamp else 0))
        if name == topics.DIAGNOSTICS.name:
            for status in message.status:
                if status.name.startswith(self._within) or not status.name.startswith('/'):
                    self._nodes[status.name] = status, arrived
            return
        self.last[name] = message
        if name in (topics.OBSERVATION.name, topics.OBSERVATIONS.name):
            self._take_rows(name, message)

    def _take_rows(self, name, message):
        try:
            run = cloud_to_run(message)
            if 'time' not in run:
                raise ValueError('no column time')
        except ValueError as error:
            self._bad[name] = str(error)
            return
        self._bad.pop(name, None)
        if not len(run):
            return
        if name == topics.OBSERVATIONS.name:
            self._rows = [run]  # all rows of the night
        elif not self._rows or run['time'][0] > self._rows[-1]['time'][-1]:
            if self._rows and not self._rows[-1].mount.agrees(run.mount):
                self._rows = []
            self._rows.append(run)
        if len(self._rows) > STARS:
            del self._rows[:-STARS]

    def state(self, now=None):
        """The state.

        Parameters
        ----------
        now : float, optional
            Monotonic time, s, to find silent nodes.

        Returns
        -------
        WatchState
        """
        state = WatchState(self._source, time_utc=utc(self._clock or self._newest or None))
        self._run = self._all_rows()
        for name, part in (('axes', self._axes), ('zero', self._zero),
                           ('encoders', self._encoders), ('sky', self._sky),
                           ('camera or temperature', self._small), ('stars', self._stars),
                           ('status', self._statuses)):
            self._bad.pop(name, None)
            try:
                part(state)
            except ValueError as error:
                self._bad[name] = str(error)
        state.nodes, state.alarms = alarms(state, self._bad, self._nodes, self._get, now, SILENT)
        return state

    def _all_rows(self):
        if not self._rows:
            return None
        if len(self._rows) > 1:
            self._rows = [PointingRun.concatenate(self._rows)]
        if len(self._rows[0]) > STARS:
            self._rows = [self._rows[0].select(slice(-STARS, None))]
        return self._rows[0]

    def _get(self, topic):
        return self.last.get(topic.name)

    def _axes(self, state):
        message = self._get(topics.INCREMENTAL)
        if message is None:
            return
        state.joints = convert.joints_of(message.name)
        stamp, angles, rates, _ = convert.read_joints(message)
        state.reading_deg = _scaled(angles, DEG)
        state.rate_deg_s = _scaled(rates, DEG)
        power_ons, latest = PowerOns(), self._get(topics.INCREMENTAL_POWER_ON)
        if latest is not None:
            power_ons.take(latest)
        power_on = power_ons.of(message.header)
        state.power_on = power_on and power_on.number
        request = self._get(topics.REQUEST)
        if request is not None and request.points:
            start, times, wanted, _ = convert.read_trajectory(request)
            at = (stamp - start) * 1e-9
            state.wanted_deg = [float(np.interp(at, times, axis)) / DEG for axis in wanted.T]

    def _zero(self, state):
        zero, model = self._active()
        if zero is None:
            return
        state.zero_arcsec = _scaled(zero.angles, ARCSEC)
        state.zero_sigma_arcsec = _scaled(zero.sigma, ARCSEC)
        state.zero_power_on = None if zero.run is None else int(zero.run)
        state.zero_by = zero.by
        state.left_by = 'zero and model' if model is not None else 'zero'

    def _active(self):
        """The active zero and model, which belong together; None if there is none."""
        pair, zero = self._get(topics.ACTIVE), self._get(topics.ZERO)
        if pair is not None:
            text, _, zero = text_to_pair(pair.data)
            return zero, PointingModel.from_json(text) if text else None
        pairs = ZeroPairs()
        for message in filter(None, (self._get(topics.ZERO_IDENTITY), zero)):
            found = pairs.take(message)
        return (None, None) if zero is None or found is None else (found[1], None)

    def _encoders(self, state):
        """Difference of the encoders, if both were read at about the same time."""
        messages = self._get(topics.INCREMENTAL), self._get(topics.ABSOLUTE)
        if None in messages:
            return
        (here, first, rates, _), (there, second, _, _) = map(convert.read_joints, messages)
        delay = (there - here) * 1e-9
        moved = np.nan_to_num(rates) * delay
        if abs(delay) > LARGEST_DELAY or not np.isfinite([*first, *second]).all():
            return
        difference = wrap(np.array(first) + moved - np.array(second))
        state.encoders_arcsec = _scaled(difference, ARCSEC)

    def _sky(self, state):
        mount = self._run.mount if self._run is not None else (
            ALTAZ if state.joints == convert.AXES else None)
        if mount is None:
            return
        for angles, name in ((state.reading_deg, 'looks_at_deg'),
                             (state.wanted_deg, 'sent_to_deg')):
            if angles and np.isfinite(angles).all():
                setattr(state, name, _on_sky(mount, *(angle * DEG for angle in angles)))

    def _small(self, state):
        miss, air = self._get(topics.MISS_DISTANCE), self._get(topics.AMBIENT)
        if miss is not None:
            state.miss_arcsec = _scaled(convert.read_sky_vector(miss), ARCSEC)
        if air is not None:
            state.temperature_c = convert.read_temperature(air)[1]

    def _stars(self, state):
        run = self._run
        if run is None:
            return
        az, el = np.array([_on_sky(run.mount, *place) for place in zip(run['az'], run['el'])]).T
        offset = run.offsets()
        left = np.full((2, len(run)), np.nan)
        zero, model = self._active()
        if zero is not None:
            held = np.full(len(run), True) if zero.run is None else run.get('run') == zero.run
            if zero.started is not None and 'encoder_start' in run:
                held = held & (np.abs(run['encoder_start'] - zero.started) < 1e-3)
            if held.any():
                model = model or PointingModel({}, mount=run.mount)
                left[:, held] = model.residuals(run.select(held), zero=zero)
        difference = [wrap(run[f'{axis}_enc'] - run.get(f'{axis}_abs')) for axis in ('az', 'el')]
        state.stars = dict(zip(STAR_COLUMNS, (
            run['time'].tolist(), run.get('run', 0.0).tolist(), az.tolist(), el.tolist(),
            *(_scaled(values, ARCSEC) for values in (*offset, *left, *difference)))))

    def _statuses(self, state):
        for key, topic in (('observer', topics.OBSERVER_STATUS), ('guard', topics.GUARD_STATUS),
                           ('calibration', topics.CALIBRATION_STATUS)):
            message = self._get(topic)
            if message is not None:
                state.messages[key] = message.message
        guard = self._get(topics.GUARD_STATUS)
        state.guard = guard and {row.key: row.value for row in guard.values}.get('state')
        observer = self._get(topics.OBSERVER_STATUS)
        if observer is not None:
            state.plan = Progress.read(observer).rows()


def full_name(namespace, topic):
    """Full name of a topic in a namespace."""
    return topic.name if topic.name.startswith('/') else f'{namespace.rstrip("/")}/{topic.name}'


def _scaled(values, unit):
    return [float(value) / unit for value in values]


def _on_sky(mount, first, second):
    """Azimuth (0 to 360) and elevation, deg."""
    az, el = mount.horizon_of(first, second)
    return [float(az) / DEG % 360.0, float(el) / DEG]
