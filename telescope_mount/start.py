# Copyright 2026 telescope_mount developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Executables of the nodes: `ros2 run` comes through here, before numpy is imported.

With several threads numpy's linear algebra adds in another order, and a log would not hold to the
last bit when it is verified. So it has one, however a node is started; who sets the variables of
`ONE_THREAD` otherwise has them so. A node ends when its `ros2 run` or `ros2 launch` has, however
that ended. One that is told to end while it imports does so without a word.
"""

import os

from msg_tools.signals import on_end

on_end(lambda *_: os._exit(0))

import sys  # noqa: E402 (what is imported from here on may be interrupted)

from . import ONE_THREAD  # noqa: E402
from .parent import end_with_parent  # noqa: E402

for _name, _value in ONE_THREAD.items():
    os.environ.setdefault(_name, _value)
end_with_parent()


def __getattr__(name):
    """What runs a node, by the name of its executable."""
    from .graph import NODES, WITH_BUILT_TYPES
    modules = NODES | WITH_BUILT_TYPES
    if name not in modules:
        raise AttributeError(f'{__name__} has no executable {name}')
    try:
        from msg_tools.node_process import node_of, run_node
        node = node_of(modules[name])
    except ImportError as error:
        from .missing_ros import missing
        line = missing(error, name)
        if line is None:
            raise
        sys.exit(f'error: {line}')
    return lambda: sys.exit(run_node(node))
