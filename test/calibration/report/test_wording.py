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

"""No sentence for people is made where rows are judged: a `Finding` has its words in the report."""

import ast

from places import ROOT

from calibration.report.wording import KINDS

#: what a column, a clock or a place may be read as has its words beside it, as an effect has
READINGS = ('readings', 'mistaken_columns', 'clock_and_site')
JUDGED = [path for part in ('estimation', 'analysis')
          for path in sorted((ROOT / 'calibration' / part).rglob('*.py'))]
_LOGGED = {'debug', 'info', 'warning', 'error', 'exception'}


def sentences(tree):
    """Texts with a space, beyond 25 characters, that are no docstring, no key and not raised."""
    skipped, joined = set(), []
    for node in ast.walk(tree):
        if isinstance(node, ast.Dict):
            skipped.update(map(id, node.keys))
        if isinstance(node, (ast.Raise, ast.Assert)) or getattr(
                getattr(node, 'func', None), 'id', '') == 'ValueError' or isinstance(
                    node, ast.Call) and getattr(
                node.func, 'attr', '') in _LOGGED:
            skipped.update(map(id, ast.walk(node)))
        elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            skipped.add(id(node.value))
    for node in ast.walk(tree):
        if id(node) in skipped:
            continue
        if isinstance(node, ast.JoinedStr):
            skipped.update(map(id, ast.walk(node)))
            joined.append(''.join(part.value if isinstance(part, ast.Constant) else '{}'
                                  for part in node.values))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            joined.append(node.value)
    return [text for text in joined if ' ' in text and len(text) > 25 and text not in KINDS]


def test_no_sentences_are_made_where_rows_are_judged():
    found = [(path.relative_to(ROOT), text) for path in JUDGED if path.stem not in READINGS
             for text in sentences(ast.parse(path.read_text()))]
    assert not found


def test_each_kind_of_finding_has_one_sentence_and_each_sentence_a_finding():
    nodes = [node for path in JUDGED for node in ast.walk(ast.parse(path.read_text()))]
    kinds = {node.args[0].value for node in nodes if isinstance(node, ast.Call) and getattr(
        node.func, 'id', '') == 'Finding' and node.args and isinstance(
            node.args[0], ast.Constant)}
    texts = {node.value for node in nodes if isinstance(node, ast.Constant)}
    assert kinds <= set(KINDS) <= texts
