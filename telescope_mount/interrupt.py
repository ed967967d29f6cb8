"""SIGTERM ends a command as Ctrl-C does, whatever it is at: in order, and with its line."""

import contextlib
import signal


def interrupt(number, _):
    """The handler of SIGTERM, as Python's own is that of SIGINT."""
    raise KeyboardInterrupt(number)


@contextlib.contextmanager
def terminated_as_interrupted():
    """Within, SIGTERM raises KeyboardInterrupt with its number; not where somebody handles it."""
    try:
        ours = signal.getsignal(signal.SIGTERM) == signal.SIG_DFL
        if ours:
            signal.signal(signal.SIGTERM, interrupt)
    except ValueError:  # not in the main thread
        ours = False
    try:
        yield
    finally:
        if ours:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
