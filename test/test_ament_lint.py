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

"""Licence lines, style and package.xml as a ROS distribution checks them."""

import configparser
import re
import subprocess
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from places import ROOT

#: built apart, with interface files and no Python
MESSAGES = ROOT / 'msg_tools' / 'telescope_mount_msgs'
WHY = 'is part of ROS 2 (ros-jazzy-ament-lint-common), and not on PyPI'


def sources():
    try:
        listed = subprocess.run(['git', 'ls-files', '-z', '*.py'], cwd=ROOT, capture_output=True,
                                check=True).stdout.decode().split('\0')
    except (OSError, subprocess.CalledProcessError):
        pytest.skip('not a clone of the repository')
    return [str(ROOT / name) for name in listed if name and (ROOT / name).is_file()]


def exceptions():
    """Rules of pep257 that this project goes without."""
    config = configparser.ConfigParser(interpolation=None)
    config.read(ROOT / 'setup.cfg')
    return re.findall(r'^D\d+|(?<=,)D\d+', config['pydocstyle']['add-ignore'], re.M)


def test_each_source_begins_with_the_licence_lines():
    bare = [path for path in sources() if (text := Path(path).read_text()).strip()
            and not re.match(r'# Copyright \d{4} telescope_mount developers\n#\n'
                             r'# Licensed under the Apache License, Version 2.0', text)]
    assert bare == []


def test_each_file_of_the_messages_names_its_licence():
    assert (MESSAGES / 'CMakeLists.txt').read_text().startswith(
        '# Copyright 2026 telescope_mount developers\n#\n# Licensed under the Apache License')
    for path in (*MESSAGES.glob('msg/*'), *MESSAGES.glob('action/*')):
        # at the end: what stands first is what `ros2 interface show` says of the type
        assert path.read_text().splitlines()[-1] == (
            '# Copyright 2026 telescope_mount developers. Apache License 2.0: LICENSE of '
            'telescope_mount.'), path


def test_addresses_of_package_and_setup_are_one():
    address = ET.parse(ROOT / 'package.xml').find('maintainer').get('email')
    assert f"maintainer_email='{address}'" in (ROOT / 'setup.py').read_text()
    assert address in (ROOT / 'QUALITY_DECLARATION.md').read_text()


@pytest.mark.parametrize(('package', 'options'), [
    ('ament_copyright', ()),
    ('ament_flake8', ('--config', str(ROOT / 'setup.cfg'))),
    ('ament_pep257', ('--add-ignore', *exceptions(), '--')),
    ('ament_xmllint', ()), ('ament_lint_cmake', ())])
def test_ament_lint(package, options, capfd):
    lint = pytest.importorskip(f'{package}.main', reason=f'{package} {WHY}')
    found = {'ament_xmllint': [str(folder / 'package.xml') for folder in (ROOT, MESSAGES)],
             'ament_lint_cmake': [str(MESSAGES / 'CMakeLists.txt')]}.get(package) or sources()
    failed = lint.main([*options, *found])
    assert not failed, capfd.readouterr()
