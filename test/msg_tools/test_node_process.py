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

"""How a process of nodes ends."""

import subprocess
import sys

HANGS = """
import ctypes, sys
from msg_tools import node_process as running
from msg_tools.node import MountNode

class Held(MountNode):
    def __init__(self):
        super().__init__('held')
        self.every(0.01, self.end)

    def end(self):
        raise KeyboardInterrupt

    def finish(self):
        print('files are closed', flush=True)

    def destroy_node(self):  # as DDS may: for ever, and no Python runs meanwhile
        ctypes.PyDLL(None).pause()

running.LETS_GO = 0.2
sys.exit(running.run_nodes([Held]))
"""


def test_a_process_that_dds_does_not_let_go_of_ends_all_the_same_with_its_files_closed():
    done = subprocess.run([sys.executable, '-c', HANGS], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (1, 'files are closed\n'), done.stderr
    assert 'destroy_node' in done.stderr
