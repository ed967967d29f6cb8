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

"""What benchmarks import of the project is there: most of them no test runs."""

import ast
from importlib import import_module

import pytest
from places import ROOT

FOLDER = ROOT / 'benchmarks'
OURS = {path.parent.name for path in ROOT.glob('*/__init__.py')}
NEIGHBOURS = {path.stem for path in FOLDER.glob('*.py')}
pytestmark = pytest.mark.skipif(not FOLDER.is_dir(), reason='benchmarks/ is not here')


def imported(path):
    """(module, name) of each ``from module import name``, wherever it stands."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.level == 0:
            yield from ((node.module, alias.name) for alias in node.names)


def defined(path):
    """Names that stand at the outermost level of a file."""
    names = set()
    for node in ast.parse(path.read_text()).body:
        for part in ast.walk(node):
            if isinstance(part, (ast.FunctionDef, ast.ClassDef)):
                names.add(part.name)
            elif isinstance(part, ast.Name) and isinstance(part.ctx, ast.Store):
                names.add(part.id)
            elif isinstance(part, (ast.Import, ast.ImportFrom)):
                names.update(alias.asname or alias.name for alias in part.names)
    return names


@pytest.mark.parametrize('path', sorted(FOLDER.glob('*.py')), ids=lambda path: path.stem)
def test_what_is_imported_is_there(path):
    for module, name in imported(path):
        if module in NEIGHBOURS:
            assert name in defined(FOLDER / f'{module}.py'), f'{module} has no {name}'
        elif module.split('.')[0] in OURS:
            try:
                found = import_module(module)
            except ModuleNotFoundError as err:  # rclpy, or another package that is not installed
                assert err.name.split('.')[0] not in OURS, err
                continue
            if not hasattr(found, name):
                import_module(f'{module}.{name}')
