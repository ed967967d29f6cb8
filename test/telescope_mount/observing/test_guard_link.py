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

"""The observer's side of the guard, with a publisher of the test."""

from types import SimpleNamespace

import numpy as np
import pytest

from msg_tools import topics
from pointing_model.mounts import ALTAZ
from telescope_mount.observing.axis_demand import Track
from telescope_mount.observing.guard_link import GuardLink


def test_a_track_that_is_not_wanted_any_more_is_withdrawn_once():
    pytest.importorskip('trajectory_msgs', reason='the messages are not installed')
    sent = []
    owners = []
    publishers = {
        topics.REQUEST: SimpleNamespace(publish=lambda message: sent.append(len(message.points))),
        topics.REQUEST_OWNER: SimpleNamespace(publish=owners.append)}
    node = SimpleNamespace(publisher=publishers.get,
                           get_fully_qualified_name=lambda: '/mount/star_observer')
    link = GuardLink(node, ALTAZ)
    link.send_command(Track(0, np.array([0.0, 20.0]), np.zeros((2, 2)), np.zeros((2, 2))))
    link.renew(True)
    link.renew(False)
    link.renew(False)
    assert sent == [2, 2, 0]
    assert [(one.key, one.value) for one in owners] == [('/mount/star_observer', '0')]
