"""Executables of the nodes: `ros2 run` comes through here, before numpy is imported.

With several threads numpy's linear algebra adds in another order, and a log would not hold to the
last bit when it is verified. So it has one, however a node is started; who sets the variables of
`threads` otherwise has them so. Under `ros2 launch` a node ends when that has, however it ended.
One that is told to end while it imports does so without a word.
"""

import os
import signal
import sys
from importlib import import_module

from .parent import end_with_parent
from .threads import ONE_THREAD

for _name, _value in ONE_THREAD.items():
    os.environ.setdefault(_name, _value)
end_with_parent()
# also where a shell without a terminal started it with Ctrl-C ignored: launch ends nodes by that
for _signal in (signal.SIGINT, signal.SIGTERM):
    signal.signal(_signal, lambda *_: os._exit(0))


def __getattr__(name):
    """The ``main`` of a node, by the name of its executable."""
    from .graph import NODES
    if name not in NODES:
        raise AttributeError(f'{__name__} has no executable {name}')
    try:
        return import_module(NODES[name]).main
    except ImportError as error:
        from .ros import missing
        line = missing(error, name)
        if line is None:
            raise
        sys.exit(f'error: {line}')
