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

"""What the terminal is told while a plan is under way, by the observer's statuses."""

from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)

from msg_tools import convert, topics
from msg_tools.readiness import GraphReports
from msg_tools.status_rows import Progress
from telescope_mount.nights import whole_night as night

OK, WARN = b'\0', b'\1'


class Watched:
    """A graph that says one status after the other."""

    def __init__(self, statuses, nodes=(('night', '/mount'), ('star_observer', '/mount'))):
        self._left, self.latest, self.reports = list(statuses), {}, GraphReports('/mount')
        self.node = SimpleNamespace(
            get_name=lambda: 'night', get_node_names_and_namespaces=lambda: list(nodes),
            context=SimpleNamespace(get_domain_id=lambda: 7))

    def spin(self, _):
        if self._left:
            level, text, progress, more = self._left.pop(0)
            self.latest[topics.OBSERVER_STATUS.name] = convert.status(
                level, 'observer', text, **progress.rows(), **more)


def says(statuses, monkeypatch, log='', **graph):
    """What is printed, in order."""
    monkeypatch.setattr(night, 'REPORTED_AFTER', -1.0)
    out = []
    watched = Watched([(level, text, Progress(**progress), more)
                       for level, text, progress, more in statuses], **graph)
    watched.reports.take(SimpleNamespace(status=[SimpleNamespace(
        name='/mount/mcap_logger', level=b'\2' if log else b'\0', message=log, values=[])]))
    night._watch(watched, SimpleNamespace(check=lambda: None, stopped=dict), 'stars 4',
                 lambda *_: None, stall=night.STALL, note=out.append,
                 hold_up=lambda text: out.append(text or 'goes on'))
    return out


def test_a_log_that_is_not_written_any_more_is_a_line_at_once(monkeypatch):
    assert says([(OK, 'done', {'state': 'done'}, {})], monkeypatch,
                log='bag: recording stopped: full') == [
        'the log is incomplete: bag: recording stopped: full']


def test_each_star_that_the_guard_refuses_is_a_line(monkeypatch):
    at = {'state': 'observing', 'step': 'stars 4'}
    assert says([
        (OK, 'stars 4', at, {'refusal': ''}),
        (OK, 'stars 4', at | {'refused': 1}, {'refusal': 'HIP 1: below the horizon'}),
        (OK, 'stars 4', at | {'refused': 1}, {'refusal': 'HIP 1: below the horizon'}),
        (OK, 'stars 4', at | {'refused': 3}, {'refusal': 'HIP 3: near the Sun'}),
        (OK, 'plan finished', {'state': 'done', 'refused': 3}, {'refusal': 'HIP 3: near the Sun'}),
    ], monkeypatch) == ['refused by the guard: HIP 1: below the horizon',
                        'refused by the guard: HIP 3: near the Sun (and 1 before)']


def test_what_was_held_up_goes_on(monkeypatch):
    at = {'state': 'observing', 'step': 'stars 4'}
    held = (WARN, 'camera silent', at, {})
    assert says([(OK, 'stars 4', at, {}), held, held, (OK, 'stars 4', at, {}), held,
                 (OK, 'plan finished', {'state': 'done'}, {})], monkeypatch) == [
        'camera silent', 'goes on', 'camera silent', 'goes on']


def test_a_night_that_stands_still_is_given_up_but_not_one_that_thinks(monkeypatch):
    monkeypatch.setattr(night, 'STALL', -1.0)
    at = {'state': 'observing', 'step': 'diagnose'}
    thinks = [(OK, 'diagnose', at, {})] * 3
    assert says([*thinks, (OK, 'plan finished', {'state': 'done'}, {})], monkeypatch) == []
    with pytest.raises(night.NightFailed, match='no progress for 0 s: waiting for stars 4'):
        says([(OK, 'stars 4', at | {'step': 'stars 4'}, {})] * 3, monkeypatch)


@pytest.mark.parametrize('driver, hinted', [((), True), ((('my_camera', '/mount'),), False)])
def test_where_no_driver_is_found_domain_and_namespace_are_named(monkeypatch, driver, hinted):
    text = 'the graph: a publisher of /mount/camera/miss_distance'
    waits = (WARN, text, {'state': 'waiting'}, {})
    done = (OK, 'plan finished', {'state': 'done'}, {})
    told = says([waits, waits, done], monkeypatch,
                nodes=[('night', '/mount'), ('star_observer', '/mount'), *driver])
    hint = [line for line in told if line.startswith('there is no driver in domain 7: give the')]
    assert (told[0], told[-1], len(hint)) == (text, 'goes on', int(hinted))


def test_who_cancelled_the_plan_is_told_and_no_resume_that_nobody_would_hear(monkeypatch):
    with pytest.raises(night.NightFailed) as end:
        says([(WARN, 'by the mount guard: aborted: call resume', {'state': 'cancelled'}, {})],
             monkeypatch)
    assert str(end.value) == 'plan cancelled by the mount guard: aborted'
