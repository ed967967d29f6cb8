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

"""What a machine with ROS 2 makes of the package: built by colcon, looked up as ros2 run does."""

import os
import re
import shutil
import subprocess
import sys

import pytest
from places import ROOT

from telescope_mount.graph import NODES, WITH_BUILT_TYPES

NAME = 'telescope_mount'
EXECUTABLES = *NODES, *WITH_BUILT_TYPES

for module in ('colcon_core', 'colcon_ros'):
    pytest.importorskip(
        module, reason='colcon is not installed (./install.sh ros,test)', exc_type=ImportError)


@pytest.fixture(scope='module')
def workspace(tmp_path_factory):
    """A workspace with a copy of the files under version control."""
    folder = tmp_path_factory.mktemp('colcon')
    try:
        listed = subprocess.run(
            ['git', 'ls-files', '-z', '--cached', '--others', '--exclude-standard'], cwd=ROOT,
            capture_output=True, check=True).stdout.decode().split('\0')
    except (OSError, subprocess.CalledProcessError):
        pytest.skip('not a clone of the repository')
    for name in filter(None, listed):
        if (ROOT / name).is_file():
            target = folder / 'src' / NAME / name
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, target)
    return folder


def colcon(workspace, *words):
    return subprocess.run(
        [sys.executable, '-m', 'colcon', '--log-base', str(workspace / 'log'), *words],
        cwd=workspace, capture_output=True, text=True, timeout=300,
        env={**os.environ, 'COLCON_HOME': str(workspace / 'home'), 'NO_COLOR': '1'})


@pytest.fixture(scope='module')
def prefix(workspace):
    done = colcon(workspace, 'build', '--build-base', str(workspace / 'build'), '--install-base',
                  str(workspace / 'install'))
    assert done.returncode == 0, done.stdout + done.stderr
    assert '1 package finished' in done.stdout
    return workspace / 'install' / NAME


def test_colcon_takes_it_for_a_ros_package(workspace):
    done = colcon(workspace, 'list')
    assert done.stdout.split() == [NAME, f'src/{NAME}', '(ros.ament_python)'], done.stderr


def test_the_messages_are_built_only_by_their_path(workspace):
    """The path that install and the action bridge name."""
    from telescope_mount.bridges.actions import BUILD, TYPES
    done = colcon(workspace, 'list', *re.search(r'--base-paths \S+', BUILD)[0].split())
    assert done.stdout.split() == [
        TYPES, f'src/{NAME}/msg_tools/{TYPES}', '(ros.ament_cmake)'], done.stderr


def test_the_ament_index_knows_it(prefix):
    marker = prefix / 'share' / 'ament_index' / 'resource_index' / 'packages' / NAME
    assert marker.is_file()
    assert (prefix / 'share' / NAME / 'package.xml').is_file()
    # the hook that puts the prefix on AMENT_PREFIX_PATH
    assert list((prefix / 'share' / NAME / 'hook').glob('ament_prefix_path.*'))


def test_launch_and_config_are_installed(prefix):
    share = prefix / 'share' / NAME
    for folder, pattern in (('launch', '*.launch.py'), ('config', '*.*')):
        wanted = {path.name for path in (ROOT / folder).glob(pattern)}
        assert wanted and {path.name for path in (share / folder).iterdir()} == wanted


def test_each_node_is_where_ros2_run_looks(prefix):
    found = {path.name for path in (prefix / 'lib' / NAME).iterdir()
             if os.access(path, os.X_OK) and path.is_file()}
    assert found == {*EXECUTABLES, 'telescope-mount', 'diagnose'}


def test_package_data_is_installed(prefix):
    site, = prefix.glob('lib/python3*/site-packages')
    for package, folder in (('encoder_sim', 'scenarios'), ('calibration', 'data')):
        wanted = {path.name for path in (ROOT / package / folder).iterdir() if path.is_file()}
        there = {path.name for path in (site / package / folder).iterdir() if path.is_file()}
        assert wanted <= there
    assert not (site / 'test').exists()


#: starts executables with what most need imported already: none of the package's own, and each of
#: them in a process of its own
START = """
import os, runpy, sys
import asyncio, erfa, numpy, scipy.optimize, rclpy.executors, rclpy.node
import geometry_msgs.msg, rcl_interfaces.srv, sensor_msgs.msg, visualization_msgs.msg
folder, out, *names = sys.argv[1:]
for name in names:
    child = os.fork()
    if child == 0:
        sys.argv = [os.path.join(folder, name), '--ros-args', '-p', 'no_such_parameter:=1']
        log = os.open(os.path.join(out, name), os.O_WRONLY | os.O_CREAT)
        os.dup2(log, 1), os.dup2(log, 2)
        code = 0
        try:
            runpy.run_path(sys.argv[0], run_name='__main__')
        except SystemExit as end:
            code = end.code or 0
        except BaseException:
            import traceback
            traceback.print_exc()
            code = 99
        sys.stdout.flush(), sys.stderr.flush()
        os._exit(code)
    print(name, os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


def test_each_executable_starts(prefix, ros_domain, tmp_path):
    """It gets as far as its own parameters, from the installed files alone."""
    site, = prefix.glob('lib/python3*/site-packages')
    folder = prefix / 'lib' / NAME
    # first, and not alone: ROS itself may come through PYTHONPATH
    paths = [str(site), *filter(None, [os.environ.get('PYTHONPATH')])]

    def start(*command):
        return subprocess.run(
            command, cwd=prefix, capture_output=True, text=True, timeout=120,
            env={**os.environ, 'PYTHONPATH': os.pathsep.join(paths)})
    done = start(sys.executable, '-c', START, str(folder), str(tmp_path), *EXECUTABLES)
    codes = dict(line.split() for line in done.stdout.splitlines())
    texts = {name: (tmp_path / name).read_text() for name in codes}
    assert codes == dict.fromkeys(EXECUTABLES, '2'), (done.stderr, texts)
    # and one as ros2 run does it
    texts['pointing_corrector (alone)'] = start(
        str(folder / 'pointing_corrector'), '--ros-args', '-p', 'no_such_parameter:=1').stderr
    for name, text in texts.items():
        assert text.startswith(
            f'error: {name.split()[0]}: unknown parameter no_such_parameter; it has '), text
        assert len(text.splitlines()) == 1


def test_package_xml_says_what_is_used():
    """Every ROS package that the sources import is declared."""
    from xml.etree import ElementTree
    package = ElementTree.parse(ROOT / 'package.xml').getroot()
    declared = {item.text for tag in ('depend', 'exec_depend') for item in package.iter(tag)}
    used = set()
    for top in ('encoder_sim', 'pointing_model', 'calibration', 'msg_tools', 'telescope_mount',
                'launch'):
        for path in (ROOT / top).rglob('*.py'):
            used.update(re.findall(r'^ *from (\w+)[\w.]* import ',
                                   path.read_text(encoding='utf-8'), re.MULTILINE))
    ros = {name for name in used if name.endswith(('_msgs', '_srvs', '_interfaces'))
           or name in ('rclpy', 'launch', 'launch_ros')}
    assert ros <= declared, ros - declared
    assert package.find('export/build_type').text == 'ament_python'
    assert {item.text for item in package.iter('test_depend')} >= {'python3-pytest'}
