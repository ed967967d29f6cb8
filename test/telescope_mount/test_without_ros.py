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

"""Where ROS is not installed: what needs none works, what needs it says so in one line."""

import json
import subprocess
import sys

import pytest
from places import LOG, ROOT

MMT = ROOT / 'calibration' / 'data' / 'mmt_2021-08-21.csv'
NEED_ROS = ('night', 'observe', 'check-drivers', 'guard', 'lifecycle', 'watch', 'experiment',
            'close-the-loop --scenario ideal', f'replay {LOG}')
SCRIPT = """
import sys, io, json
from contextlib import redirect_stderr, redirect_stdout
from telescope_mount.missing_ros import _ROS_PACKAGES
for name in _ROS_PACKAGES:
    sys.modules[name] = None  # as if it were not installed
from telescope_mount.cli import main
told = []
for words in json.loads(sys.argv[1]):
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = main(words)
    told.append([code, out.getvalue(), err.getvalue()])
print(json.dumps(told))
"""


@pytest.fixture(scope='module')
def ran():
    """(code, stdout, stderr) of each of several commands, in one process without ROS."""
    def run(commands, folder):
        done = subprocess.run(
            [sys.executable, '-c', SCRIPT, json.dumps([c.split() for c in commands])], cwd=folder,
            capture_output=True, text=True, env={'PYTHONPATH': str(ROOT)})
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)
    return run


def test_runs_and_logs_are_read(ran, tmp_path):
    told = ran((f'fit {MMT} --save m.json', f'fit {LOG} --terms IA,IE', f'info {LOG}',
                f'verify {LOG}', f'export {LOG} run.csv', f'export {LOG} topics --topics offset',
                f'track {MMT} --json t.json', f'watch {LOG}',
                f'recover {LOG} --out whole', 'export m.json m.mod --to tpoint',
                'apply m.json run.csv --out out.csv'), tmp_path)
    # the last bit of the log may be another on another processor: 1
    assert told[3][0] in (0, 1) and 'of 87 are identical bit by bit' in told.pop(3)[1]
    assert [code for code, _, _ in told] == [0] * len(told), told
    assert (tmp_path / 'out.csv').is_file() and (tmp_path / 't.json').is_file()


def test_what_needs_it_says_how_to_install_it(ran, tmp_path):
    for (code, out, err), words in zip(ran(NEED_ROS, tmp_path), NEED_ROS):
        assert (code, out, err.count('\n')) == (2, '', 1), (words, err)
        assert err.startswith(f'error: {words.split()[0]} needs ROS 2')
        assert 'ros' in err.split('do: ')[1]
    assert not list(tmp_path.iterdir())


def test_a_csv_is_fitted_without_ros_being_looked_for():
    code = ('import sys; from telescope_mount.cli import main\n'
            f'main(["fit", {str(MMT)!r}])\nprint("LOADED", *sys.modules)')
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    loaded = {name.split('.')[0] for name in done.stdout.split('LOADED ')[1].split()}
    assert not loaded & {'rclpy', 'rcl_interfaces', 'builtin_interfaces', 'matplotlib'}


def test_a_node_says_it_too():
    code = ('import sys; sys.modules["rclpy"] = None\n'
            'from telescope_mount.start import calibration')
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True)
    assert done.returncode == 1 and done.stderr.count('\n') == 1
    assert done.stderr.startswith('error: calibration needs ROS 2')
