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

from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)

from telescope_mount.running_graph.graph_client import GraphClient


class Answered(GraphClient):
    """Without a graph: what a node answers, asked so often, and its state."""

    def __init__(self, success, times, state):
        self.answer, self.now = (SimpleNamespace(success=success), times), state

    def ask(self, kind, name, request):
        return self.answer

    def state(self, name):
        return self.now


@pytest.mark.parametrize('success, times, state, made', [
    (True, 1, 'active', True), (False, 1, 'active', False),
    # the answer to the first question was lost
    (False, 2, 'active', True), (False, 2, 'inactive', False)])
def test_a_transition_whose_answer_was_lost_is_seen_by_the_state(success, times, state, made):
    assert Answered(success, times, state).change('mount_guard', 'activate') is made


def test_a_shutdown_leads_to_the_end():
    assert Answered(False, 2, 'finalized').change('mount_guard', 'unconfigured_shutdown')
    assert not Answered(True, 1, 'active').change('mount_guard', 'levitate')
