import numpy as np
import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)

from encoder_reading import messages
from encoder_reading.axis_reader import AxisReader
from encoder_reading.design import Design
from encoder_reading.messages import Batch, frame_message, read_frame


class Node:
    """Stands for one whose executor runs the timer when the test says so."""

    def create_timer(self, period, callback, autostart, clock):
        assert period == 0.0 and not autostart
        self.callback, self.due = callback, False
        return self

    def reset(self):
        self.due = True

    def cancel(self):
        self.due = False

    def spin(self):
        if self.due:
            self.callback()


@pytest.fixture
def clock(monkeypatch):
    """A monotonic clock that the test advances."""
    now = [100.0]
    monkeypatch.setattr(messages.time, 'monotonic', lambda: now[0])
    return now


def test_what_comes_while_work_is_done_is_done_together(clock):
    node, done = Node(), []

    def work(items):
        done.append(items)
        clock[0] += 0.4

    batch = Batch(node, work, lambda: 4)
    batch.add(0)
    assert done == [[0]]  # nothing waited: at once
    for i in range(1, 11):
        batch.add(i)
    assert done == [[0]] and node.due
    node.spin()
    assert done[1:] == [[1, 2, 3, 4], [5, 6, 7, 8], [9, 10]] and not node.due
    # and at once again after a pause, with what may still wait
    batch.add(11)
    assert node.due
    clock[0] += 2.0
    batch.add(12)
    assert done[4:] == [[11, 12]] and not node.due
    node.spin()
    assert len(done) == 5


def test_frames_there_and_back():
    rng = np.random.default_rng(1)
    axes = [AxisReader(Design(heads=2), 'azimuth'), AxisReader(Design(pixels=2048), 'elevation')]
    frames = [rng.integers(0, 256, (2, 1800), dtype=np.uint8),
              rng.integers(0, 256, (1, 2048), dtype=np.uint8)]
    message = frame_message(5_000_000_001, frames)
    assert (message.height, message.width, message.step) == (3, 2048, 2048)
    stamp, back = read_frame(message, axes)
    assert stamp == 5_000_000_001
    assert all(np.array_equal(*pair) for pair in zip(frames, back))
    assert not any(part.flags.owndata for part in back)
