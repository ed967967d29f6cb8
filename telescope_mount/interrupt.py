"""Ctrl-C and SIGTERM end a command in order, with one line, whatever it is at."""

import contextlib
import signal

#: handlers of Python's own
_OWN = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: signal.SIG_DFL}
_told = []


def interrupt(number, _):
    """The handler of both."""
    _told.append(number)
    raise KeyboardInterrupt(number)


def check():
    """Raise once more what an import, or a library's ``except:``, has swallowed.

    For long work that nothing has to end in order.

    Raises
    ------
    KeyboardInterrupt
    """
    if _told:
        raise KeyboardInterrupt(_told[-1])


@contextlib.contextmanager
def interrupted_in_order():
    """Within, both raise KeyboardInterrupt with their number, where nobody else handles them.

    An import makes another error of it: that is not what ended the command.
    """
    ours = []
    with contextlib.suppress(ValueError):  # not in the main thread
        for number, own in _OWN.items():
            if signal.getsignal(number) == own:
                signal.signal(number, interrupt)
                ours.append(number)
    _told.clear()
    try:
        yield
    except Exception:
        if _told:
            raise KeyboardInterrupt(_told[-1]) from None
        raise
    finally:
        for number in ours:
            signal.signal(number, _OWN[number])
