"""Memory that a process does not need any more, given back to the system."""

import ctypes
from functools import cache


@cache
def _trim():
    try:
        return ctypes.CDLL(None).malloc_trim
    except (AttributeError, OSError, TypeError):
        return lambda pad: 0  # of glibc alone


def give_back():
    """After work that took much: else the heap keeps its pages for more of it. About 1 ms."""
    _trim()(0)
