"""The command line, the one description of the node graph, and the door for Python programs.

``from telescope_mount import read_run, fit, diagnose, apply``: see `telescope_mount.api`, which is
read when one of them is requested. None of them needs ROS.
"""

__all__ = ['apply', 'diagnose', 'fit', 'read_run']


def __getattr__(name):
    """What `api` offers, when it is requested: nodes import this package and need none of it."""
    if name not in __all__:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    from . import api
    found = globals()[name] = getattr(api, name)
    return found


def __dir__():
    return sorted({*globals(), *__all__})
