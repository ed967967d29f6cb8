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

"""Executables of the nodes: `ros2 run` enters here, before numpy is imported.

With several threads numpy's linear algebra sums in another order, and a log could not be verified
to the last bit. So one thread is set for every way to start a node; variables of `ONE_THREAD` that
are already set are kept. A node ends with its `ros2 run` or `ros2 launch`, however that ended. A
node that is told to end during its imports does so silently.
"""

import os

from msg_tools.signals import on_end

on_end(lambda *_: os._exit(0))

import sys  # noqa: E402 (imports from here on may be interrupted)

from . import ONE_THREAD  # noqa: E402
from .processes.parent import end_with_parent  # noqa: E402

for _name, _value in ONE_THREAD.items():
    os.environ.setdefault(_name, _value)
end_with_parent()


def __getattr__(name):
    """The function that runs a node, by the name of its executable."""
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
