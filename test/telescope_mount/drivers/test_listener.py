"""The simulator's nodes as drivers: nothing wrong is found of them."""

import pytest

from pointing_model.mounts import ALTAZ
from telescope_mount.drivers.judgement import judge
from telescope_mount.drivers.samples import OK, WRONG
from telescope_mount.graph import SIMULATED, night_graph


@pytest.fixture
def simulator(ros_domain, tmp_path):
    from telescope_mount.processes import Processes
    started = Processes(tmp_path / 'nodes', ros_domain)
    for spec in night_graph(bag='', time_scale=1.0):
        if spec.name in SIMULATED:
            started.start(spec)
    yield started
    started.stop()


def test_the_simulators_nodes_keep_the_contract(simulator, ros_domain):
    from telescope_mount.drivers.listener import Listener
    listener = Listener(ALTAZ, ros_domain, '/mount')
    try:
        def there():
            simulator.check()
            heard = listener.heard(0.0)
            return heard.followers and 'home' in heard.services and all(
                len(stream.stamps) >= enough for stream, enough in (
                    (heard.incremental, 20), (heard.absolute, 20), (heard.camera, 3)))
        assert listener.spin(60.0, there)
        found = judge(listener.heard(3.0))
    finally:
        listener.close()
    # gaps and lateness are this machine's own
    assert [f for f in found if f.level == WRONG and 'silent' not in f.text] == []
    good = {f.of for f in found if f.level == OK}
    assert good >= {'incremental/joint_states', 'absolute/joint_states', 'camera/miss_distance',
                    'command', 'home'}
