import contextlib
import signal

import pytest

from telescope_mount.interrupt import check, interrupt, interrupted_in_order


def test_a_signal_that_a_library_has_swallowed_is_raised_once_more():
    check()  # none has come
    with pytest.raises(KeyboardInterrupt) as ended, interrupted_in_order():
        with contextlib.suppress(KeyboardInterrupt):
            interrupt(signal.SIGTERM, None)
        check()
    assert ended.value.args == (signal.SIGTERM,)
    with interrupted_in_order():
        check()  # of the command before
