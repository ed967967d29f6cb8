import numpy as np
import pytest

from msg_tools.power_on import PowerOn, read_frame, since


def test_there_and_back_to_the_bit():
    rng = np.random.default_rng(1)
    for ns in rng.integers(10**18, 2 * 10**18, 200):
        told = PowerOn(3, since(int(ns)))
        assert read_frame(told.frame) == told
        assert abs(told.started - ns * 1e-9) < 6e-4


@pytest.mark.parametrize('frame', ['', 'mount_enu', 'power_on_2', 'power_on_x@1.0', 'power_on_2@'])
def test_a_frame_that_tells_no_power_on(frame):
    assert read_frame(frame) is None
