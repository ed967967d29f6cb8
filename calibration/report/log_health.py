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

"""State of the instruments in the log of a night: rates, gaps, marks, decoding."""

from collections import deque

import numpy as np

from msg_tools.bag.sqlite import open_bag
from msg_tools.bag.topic_names import prefixes_of
from msg_tools.gaps import LogGaps
from msg_tools.homing import cloud_to_homing
from msg_tools.units import ARCSEC

# older logs: errors as joint positions
_OLDER_SIGMA = 'absolute/sigma'
#: suffixes of the topics of instruments -> names of the streams
STREAMS = {
    'incremental/joint_states': 'incremental encoder', 'absolute/joint_states': 'absolute encoder',
    'absolute/pose': 'absolute encoder, errors', _OLDER_SIGMA: 'absolute encoder, errors',
    'absolute/frame': 'absolute encoder, images',
    'incremental/homing': 'marks', 'camera/miss_distance': 'camera', 'inclinometer': 'inclinometer',
    'ambient/temperature': 'thermometer', 'observation': 'observations'}
#: largest number of messages that are all read: takes half a minute
MOST_READ = 1_000_000
#: largest number of error messages and of diagnostics that are decoded
_SIGMAS, _STATUSES = 2000, 1500
#: prefixes of diagnostic values about topics, which are in the table of streams already
_OF_TOPICS = ('instance', 'publishes ', 'published ', 'subscribes ', 'received ', 'last ', 'gaps ',
              'rate ')
LEVELS = ('ok', 'warning', 'error', 'silent')


def log_health(path):
    """State of the instruments in the log of a night.

    Parameters
    ----------
    path : str or Path
        The log of the night; a log of the simulator's truth is refused.

    Returns
    -------
    dict
        ``streams``: for each stream ``what``, ``topic``, ``count``, ``rate_hz`` (mean),
        ``interval_s`` (median), ``longest_s`` and ``lost``, the last three None if the log is so
        large that only its index was read (``whole`` False). ``marks``: for each power-on and axis
        the values of `msg_tools.homing`, with ``worst_error_counts``. ``sigmas_arcsec``: for each
        axis ``count``, ``middle`` (median), ``beyond_95`` (95 % quantile), ``largest``, ``none``
        (number of missing values) of the standard errors of absolute readings. ``nodes``:
        ``name``, ``level`` and ``worst`` (of `LEVELS`), ``message``, ``values``.

    Raises
    ------
    ValueError, OSError
        It is no log, or cannot be read.
    """
    bag = open_bag(path)
    named, prefixes = {}, prefixes_of(bag)
    prefix = prefixes[0] if len(prefixes) == 1 else '/'
    for topic in bag.topics:
        for end, what in STREAMS.items():
            if topic.name.startswith(prefix) and topic.name.endswith('/' + end) and topic.count:
                named[topic.name] = what, topic
    whole = sum(topic.count for _, topic in named.values()) <= MOST_READ
    streams, errors = _streams(bag, named, whole)
    simulated = any(topic.name == '/clock' and topic.count for topic in bag.topics)
    return {'whole': whole, 'simulated_clock': simulated, 'streams': streams,
            'marks': _marks(bag, named), 'sigmas_arcsec': _sigmas(errors, _axes(bag, named)),
            'nodes': _nodes(bag),
            'problems': list(bag.problems)}


def _streams(bag, named, whole):
    """A row for each stream, and an evenly spaced, decoded sample of the error messages."""
    span = 0.0 if bag.start_time is None else (bag.end_time - bag.start_time) * 1e-9
    times = {name: [] for name in named}
    gaps = LogGaps({name: topic.latched for name, (_, topic) in named.items()})
    steps = {name: max(1, topic.count // _SIGMAS) for name, (what, topic) in named.items()
             if what.endswith('errors')}
    errors = []
    for message in bag.messages(list(named)) if whole and named else ():
        name, own = message.topic, times[message.topic]
        if name in steps and len(own) % steps[name] == 0:
            errors.append(bag.decode(message))
        own.append(message.log_time)
        gaps.add(name, message.sequence)
    out = []
    for name, (what, topic) in sorted(named.items(), key=lambda item: list(STREAMS.values()).index(
            item[1][0])):
        row = {'what': what, 'topic': name, 'count': topic.count, 'interval_s': None,
               'longest_s': None, 'lost': gaps.counts(name)[0],
               'rate_hz': (topic.count - 1) / span if topic.count > 1 and span > 0.0 else None}
        if len(times[name]) > 1:
            intervals = np.diff(np.array(times[name], float)) * 1e-9
            moved = intervals[intervals > 0.0]  # a simulated clock gives many equal times
            if len(moved):
                row.update(interval_s=float(np.median(moved)), longest_s=float(moved.max()))
        out.append(row)
    return out, errors


def _marks(bag, named):
    topics = [name for name, (what, _) in named.items() if what == 'marks']
    out = {}
    for message in bag.messages(topics, decode=True) if topics else ():
        try:
            axes = cloud_to_homing(message.data)
        except ValueError:
            continue
        for axis, homing in axes.items():
            before = out.get((homing.power_on, axis), {})
            error = abs(homing.mark_error) if np.isfinite(homing.mark_error) else None
            worst = before.get('worst_error_counts')
            out[homing.power_on, axis] = {
                'power_on': homing.power_on, 'axis': axis, 'homed': homing.homed,
                'side': homing.side or before.get('side', ''), 'passages': homing.passages,
                'missed': homing.missed_marks,
                'worst_error_counts': max((v for v in (error, worst) if v is not None),
                                          default=None),
                'supply': _or_none(homing.supply), 'temperature': _or_none(homing.temperature)}
    return [out[key] for key in sorted(out)]


def _or_none(value):
    return float(value) if np.isfinite(value) else None


def _axes(bag, named):
    """Names of both axes, from the messages of the absolute encoder."""
    readings = [name for name in named if name.endswith('/absolute/joint_states')]
    first = next(bag.messages(readings, decode=True), None) if readings else None
    return ('first axis', 'second axis') if first is None else tuple(first.data.name)


def _sigmas(errors, axes):
    out = {}
    with np.errstate(invalid='ignore'):  # a negative variance means unknown
        rows = [np.sqrt(np.take(one.pose.covariance, (35, 28))) if hasattr(one, 'pose')
                else one.position for one in errors]
    for axis, found in zip(axes, np.divide(rows, ARCSEC).T):
        good = found[np.isfinite(found)]
        out[axis] = {'count': len(found), 'none': int(len(found) - len(good)), **({} if not len(
            good) else {'middle': float(np.median(good)), 'largest': float(good.max()),
                        'beyond_95': float(np.quantile(good, 0.95))})}
    return out


def _nodes(bag):
    topic = next((t for t in bag.topics if t.name.endswith('/diagnostics') and t.count), None)
    if topic is None:
        return []
    observer = [t.name for t in bag.topics if t.name.endswith('/observer/status') and t.count]
    # only the end of a long night: it includes the final counters
    kept = deque(bag.messages([topic.name, *observer]), maxlen=_STATUSES)
    # compare by order: a simulated clock may stand still
    over = max((i for i, message in enumerate(kept) if message.topic in observer),
               default=len(kept))
    out = {}
    for i, message in enumerate(kept):
        if message.topic in observer:
            continue
        diagnostics = bag.decode(message)
        for status in getattr(diagnostics, 'status', ()):
            level, before = level_of(status), out.get(status.name)
            # at shutdown nodes stop one after the other, and report each other as missing
            if i > over and before and level > LEVELS.index(before['level']):
                continue
            out[status.name] = {
                'name': status.name, 'level': LEVELS[level], 'message': status.message,
                'worst': LEVELS[max(level, LEVELS.index(before['worst']) if before else 0)],
                'values': {v.key: v.value for v in status.values
                           if not v.key.startswith(_OF_TOPICS)}}
    return [out[name] for name in sorted(out)]


def level_of(status):
    """Of a DiagnosticStatus, index in `LEVELS`; a live one has it as a byte."""
    value = status.level[0] if isinstance(status.level, bytes) else status.level
    return min(int(value), len(LEVELS) - 1)
