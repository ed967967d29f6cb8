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

"""How an executable of `ros2 run` begins."""

import resource
import signal
import subprocess
import sys

import pytest


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_node_that_is_told_to_end_while_it_imports_does_so_without_a_word(number):
    # as a script starts it in the background: with SIGINT ignored
    done = subprocess.run(
        [sys.executable, '-c', 'import os, telescope_mount.start; '
         f'os.kill(os.getpid(), {int(number)}); print("went on")'], capture_output=True,
        text=True, check=False, preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN))
    assert (done.returncode, done.stdout, done.stderr) == (0, '', '')


@pytest.mark.parametrize('program', [
    'from telescope_mount.start import camera as main', 'from telescope_mount.cli import main'])
def test_a_limit_of_open_files_that_does_not_suffice_is_one_line(program):
    pytest.importorskip(
        'rclpy', reason='rclpy is not installed (./install.sh ros)', exc_type=ImportError)
    done = subprocess.run(
        [sys.executable, '-c', f'import sys; {program}; sys.exit(main())', 'guard'],
        capture_output=True, text=True, check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (24, 24)))
    assert (done.returncode, done.stderr) == (
        2, 'error: only 24 files may be open in a process; ROS needs 64: ulimit -n 1024\n')
