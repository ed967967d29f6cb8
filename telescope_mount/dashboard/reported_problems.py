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

"""Warnings of the dashboard: nodes, their statuses, the zero, the encoders."""

import json

import numpy as np

from calibration.report.log_health import LEVELS, level_of
from msg_tools import topics


def alarms(state, bad, reports, last, now, patience):
    """Alarms, and the states of the nodes.

    Parameters
    ----------
    state : WatchState
        Rest of the state.
    bad : dict of str to str
        Messages that could not be used, and why.
    reports : dict of str to (DiagnosticStatus, float)
        Last report of each node, and time of reception (monotonic s, None in a log).
    last : callable
        Returns the last message of a topic, or None.
    now : float or None
        Monotonic time, s, to find silent nodes.
    patience : float
        Time without a report until a node counts as silent, s.

    Returns
    -------
    nodes : dict of str to dict
        ``level`` and ``said`` of each.
    alarms : list of dict
        Likewise, worst first.
    """
    found = [(1, f'{name}: a message that cannot be used: {error}') for name, error in bad.items()]
    silent = {} if now is None else {
        name: now - arrived for name, (_, arrived) in reports.items()
        if arrived is not None and now - arrived > patience}
    if len(silent) == len(reports) > 1:
        found.append((3, f'all {len(silent)} nodes are silent for {min(silent.values()):.0f} s: '
                      'the graph has ended, or is not heard any more'))
    else:
        found += [(3, f'{name}: silent for {age:.0f} s') for name, age in sorted(silent.items())]
    nodes = {}
    for name, (status, _) in sorted(reports.items()):
        level = level_of(status)
        if name in silent:
            nodes[name] = {'level': 'silent', 'said': status.message}
            continue
        nodes[name] = {'level': LEVELS[level], 'said': status.message}
        if level:
            found.append((level, f'{name}: {status.message}'))
    for topic in (topics.OBSERVER_STATUS, topics.GUARD_STATUS, topics.CALIBRATION_STATUS):
        message = last(topic)
        # a node that has a status says the same on /diagnostics, with more about it
        if message is not None and level_of(message) and (
                nodes.get(message.name, {}).get('level', 'ok') == 'ok'):
            found.append((level_of(message), f'{topic.name}: {message.message}'))
    if state.reading_deg and not np.isfinite(state.reading_deg).all():
        found.append((1, 'the incremental encoder is not homed'))
    if None not in (state.power_on, state.zero_power_on) and state.power_on != state.zero_power_on:
        found.append((1, f'the zero is of power-on {state.zero_power_on}, and this is power-on '
                      f'{state.power_on}'))
    found += [(2, sentence) for sentence in _of_cross_check(last(topics.CALIBRATION_REPORT))]
    found = dict.fromkeys(sorted(found, key=lambda row: -row[0]))
    return nodes, [{'level': LEVELS[level], 'said': said} for level, said in found]


def _of_cross_check(message):
    try:
        return json.loads(message.data)['witnesses']['alarms'] if message else []
    except (ValueError, KeyError, TypeError):
        return []
