"""Signals that end what runs in order: Ctrl-C, SIGTERM, and SIGHUP of a terminal that is closed."""

import signal

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def on_end(handler):
    """Have `handler` called at each of `ENDING`.

    Ctrl-C counts also where a shell without a terminal has a process ignore it: launch ends nodes
    by that. SIGHUP does not where it is ignored (nohup).

    Parameters
    ----------
    handler : callable
        As of `signal.signal`.
    """
    for number in ENDING:
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, handler)
