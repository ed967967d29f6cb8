"""Memory that a process does not need any more, given back to the system."""

import ctypes
from functools import cache

#: glibc's mallopt: from how many bytes on a block is a map of its own
_MMAP_THRESHOLD, _LARGE = -3, 128 * 1024


@cache
def _of_libc(name):
    try:
        return getattr(ctypes.CDLL(None), name)
    except (AttributeError, OSError, TypeError):
        return lambda *args: 0  # of glibc alone


def large_apart():
    """Large blocks stay apart from the heap, and go when they are freed.

    By default the first that is freed moves the limit up, to 32 MB at most: messages that grow with
    the night then leave holes in the heap, each too small for the next.
    """
    _of_libc('mallopt')(_MMAP_THRESHOLD, _LARGE)


def give_back():
    """After work that took much: else the heap keeps its pages for more of it. About 1 ms."""
    _of_libc('malloc_trim')(0)
