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

"""The interface files of telescope_mount_msgs: their grammar, comments and names."""

import re
from dataclasses import fields
from xml.etree import ElementTree

import pytest
from places import ROOT

from msg_tools.status_rows import Progress, Stage
from telescope_mount.bridges.actions.action_goals import diagnosis_fields
from telescope_mount.graph import WITH_BUILT_TYPES
from telescope_mount.observing.plan import VERBS

PACKAGE = ROOT / 'msg_tools' / 'telescope_mount_msgs'
FILES = sorted([*PACKAGE.glob('msg/*.msg'), *PACKAGE.glob('action/*.action')])
PRIMITIVES = ('bool', 'string', 'int8', 'int32', 'uint32', 'float64')
FIELD = re.compile(r'(?P<type>[A-Za-z][A-Za-z0-9]*)(?P<array>\[\])? (?P<name>[a-z][a-z0-9_]*)')
CONSTANT = re.compile(r'string (?P<name>[A-Z][A-Z_]*) = "(?P<value>[a-z_]+)" +# \S.*')
UNIT = re.compile(r'\[(1|rad|s|probability|rad, or rad per unit of the driver|as values)\]')


def sections(path):
    """Of each section its fields (name, type, comment) and constants (name, value)."""
    out = [([], {})]
    comment = []
    for line in path.read_text(encoding='utf-8').splitlines():
        assert len(line) <= 100, line
        if line == '---':
            out.append(([], {}))
        elif line.startswith('#'):
            comment.append(line)
            continue
        elif found := CONSTANT.fullmatch(line):
            out[-1][1][found['name']] = found['value']
        elif line:
            found = FIELD.fullmatch(line)
            assert found, f'{path.name}: {line!r} is no field'
            out[-1][0].append((found['name'], found['type'] + (found['array'] or ''),
                               ' '.join(comment)))
        comment = []
    return out


def test_the_package_has_a_few_files_and_builds_all():
    listed = re.findall(r'"((?:msg|action)/\w+\.\w+)"', (PACKAGE / 'CMakeLists.txt').read_text())
    assert listed == sorted(f'{path.parent.name}/{path.name}' for path in FILES)[3:] + sorted(
        f'{path.parent.name}/{path.name}' for path in FILES)[:3]
    assert len(FILES) == 6


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.name)
def test_grammar_and_units(path):
    first, *_ = path.read_text(encoding='utf-8').splitlines()
    assert re.fullmatch(r'# [A-Z].*\.', first), first
    parts = sections(path)
    assert len(parts) == (3 if path.suffix == '.action' else 1)
    for named, constants in parts:
        assert len({name for name, *_ in named}) == len(named)
        assert [value.upper() for value in constants.values()] == list(constants)
        for name, kind, comment in named:
            plain = kind.removesuffix('[]')
            assert plain in PRIMITIVES or (PACKAGE / 'msg' / f'{plain}.msg').is_file(), kind
            assert comment, f'{path.name}: {name} has no comment'
            if plain in PRIMITIVES[2:]:
                assert UNIT.search(comment), f'{path.name}: {name} has no unit'


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.name)
def test_the_parser_of_ros_takes_them(path):
    parser = pytest.importorskip('rosidl_adapter.parser', reason='rosidl is not installed',
                                 exc_type=ImportError)
    text = path.read_text(encoding='utf-8')
    if path.suffix == '.action':
        spec = parser.parse_action_string(PACKAGE.name, path.stem, text)
        found = [spec.goal, spec.result, spec.feedback]
    else:
        found = [parser.parse_message_string(PACKAGE.name, path.stem, text)]
    assert [[field.name for field in one.fields] for one in found] == [
        [name for name, *_ in named] for named, _ in sections(path)]
    assert [{one.name: one.value for one in each.constants} for each in found] == [
        constants for _, constants in sections(path)]


def named(name, part=0):
    path = next(path for path in FILES if path.name == name)
    return [name for name, *_ in sections(path)[part][0]]


def test_fields_are_those_of_the_topics():
    assert set(named('PlanProgress.msg')) == {
        'state', 'message', 'steps', *(field.name for field in fields(Progress))} - {'plan'}
    assert tuple(named('Diagnose.action', 2)) == Stage._fields
    rms = {'rms_arcsec': 1.0, 'cv_rms_arcsec': 1.0}
    found = diagnosis_fields({'verdict': 'none', 'published': False, 'before': rms, 'after': rms,
                              'effects': [{'name': '', 'driver': '', 'coefficients_arcsec': {},
                                           'sigma_arcsec': {}, 'p_family': 0.5,
                                           'removes_rms_arcsec': 1.0}]}, '')
    assert set(named('Diagnose.action', 1)) == set(found)
    assert named('Effect.msg') == list(found['effects'][0])


def test_constants_are_all_that_there_are():
    steps, = sections(PACKAGE / 'msg' / 'PlanStep.msg')
    assert list(steps[1].values()) == list(VERBS)
    from calibration.report.verdict_wording import VERDICTS
    verdicts = sections(PACKAGE / 'action' / 'Diagnose.action')[1][1]
    # what is taken back is by `judge`
    assert set(verdicts.values()) == set(VERDICTS) - {'taken_back'}


def test_the_package_is_one_of_the_project_which_does_not_need_it():
    root, mine = (ElementTree.parse(folder / 'package.xml').getroot() for folder in (ROOT, PACKAGE))
    for tag in ('version', 'maintainer', 'license'):
        assert root.find(tag).text == mine.find(tag).text
    assert root.find('maintainer').attrib == mine.find('maintainer').attrib
    assert mine.find('name').text == PACKAGE.name
    assert PACKAGE.name not in (ROOT / 'package.xml').read_text()
    assert PACKAGE.name not in (ROOT / 'setup.py').read_text()
    assert list(WITH_BUILT_TYPES) == ['action_bridge']
