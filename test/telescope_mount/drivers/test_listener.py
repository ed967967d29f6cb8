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

"""The simulator's nodes as drivers: nothing wrong is found of them."""

import numpy as np
import pytest

from msg_tools.units import DEG
from pointing_model.mounts import ALTAZ
from telescope_mount.drivers.contract import check_contract
from telescope_mount.drivers.samples import OK, WRONG
from telescope_mount.graph import SIMULATED, night_graph


@pytest.fixture
def simulator(ros_domain, tmp_path):
    from telescope_mount.processes.node_processes import Processes
    started = Processes(tmp_path / 'nodes', ros_domain)
    for spec in night_graph(bag='', time_scale=5.0):
        if spec.name in (*SIMULATED, 'mount_guard'):
            started.start(spec)
    yield started
    started.stop()


def test_the_simulators_nodes_keep_the_contract(simulator, ros_domain, monkeypatch):
    from telescope_mount.drivers import listener as of
    monkeypatch.setattr(of, 'RAMP', 0.4)  # at 0.3 its acceleration is the limit itself
    monkeypatch.setattr(of, 'LOOK', -0.7)  # the camera is another test's
    monkeypatch.setattr(of, 'NEAR', 0.005 * DEG)
    listener = of.Listener(ALTAZ, ros_domain, '/mount')
    try:
        assert listener.home(60.0).level == OK

        def there():
            simulator.check()
            samples = listener.samples(0.0)
            return samples.followers and 'home' in samples.services and all(
                len(stream.stamps) >= enough for stream, enough in (
                    (samples.incremental, 20), (samples.absolute, 20), (samples.camera, 3)))
        assert listener.spin(60.0, there)
        found = check_contract(listener.samples(3.0))
        # a guard that runs is asked; it moves the mount
        _, rests, _ = listener.nudge(0.03 * DEG)
        assert np.ptp([rest.demand for rest in rests], axis=0) == pytest.approx(0.03 * DEG)
    finally:
        listener.close()
    # gaps and lateness are this machine's own
    assert [f for f in found if f.level == WRONG and 'silent' not in f.text] == []
    good = {f.of for f in found if f.level == OK}
    assert good >= {'incremental/joint_states', 'absolute/joint_states', 'camera/miss_distance',
                    'command', 'home'}
