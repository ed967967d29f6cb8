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


@pytest.mark.parametrize('program, words', [
    ('start import camera as main', []), ('cli import main', ['guard'])])
def test_a_limit_of_open_files_that_does_not_suffice_is_one_line(program, words):
    pytest.importorskip(
        'rclpy', reason='rclpy is not installed (./install.sh ros)', exc_type=ImportError)
    done = subprocess.run(
        [sys.executable, '-c', f'import sys; from telescope_mount.{program}; sys.exit(main())',
         *words], capture_output=True, text=True, check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (24, 24)))
    assert (done.returncode, done.stderr) == (
        2, 'error: only 24 files may be open in a process; ROS needs 64: ulimit -n 1024\n')


@pytest.mark.parametrize('words, line', [
    (['-p', 'latitude_deg:=30.0'], '-p latitude_deg:=30.0 would be ignored'),
    (['--ros-args', '-p', 'latitude_deg:=30.0', '--', 'guard'], 'guard would be ignored'),
    (['--ros-args', 'latitude_deg:=30.0'], "'latitude_deg:=30.0'"),
    (['--ros-args', '--params-file', 'no.yaml'], "'--params-file no.yaml'. Error: Error opening"),
])
def test_words_that_ros_ignores_or_does_not_take_are_refused_in_one_line(words, line):
    """A guard had run with its defaults."""
    pytest.importorskip('rclpy', exc_type=ImportError)
    done = subprocess.run(
        [sys.executable, '-c', 'import sys; from telescope_mount.start import mount_guard; '
         'sys.exit(mount_guard())', *words], capture_output=True, text=True, check=False)
    assert done.returncode == 2 and done.stderr.count('\n') == 1
    assert line in done.stderr and done.stderr.endswith(
        '; write --ros-args -p PARAMETER:=VALUE --params-file FILE\n')
