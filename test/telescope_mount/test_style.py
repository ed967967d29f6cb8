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

"""Words that people read: no long sentence, no word of the list in docs/style.md."""

import argparse
import ast
import re
from html.parser import HTMLParser
from io import StringIO

import numpy as np
import pytest
import yaml
from a_night import a_night
from places import ROOT
from rich.console import Console
from simulated import FAST, backlash, night

from calibration.analysis.diagnosis.diagnosis import diagnose
from calibration.analysis.run_fit import fit_run
from calibration.report.diagnosis_page import render
from calibration.report.diagnosis_terminal import diagnosis_tables, summary_lines
from calibration.report.diagnosis_view import view_of
from calibration.report.documents import fit_document
from calibration.report.fit_page import render_fit
from calibration.report.fit_tables import fit_tables
from calibration.report.night_page import render_night
from calibration.report.wording import KINDS
from pointing_model import model_document
from telescope_mount.command_parser import make_parser

LONGEST = 25  # words
#: where words of pages, terminal, nodes and of refused input are
SOURCES = [path for part in ('calibration', 'encoder_reading', 'encoder_sim', 'msg_tools',
                             'pointing_model', 'telescope_mount')
           for path in (ROOT / part).rglob('*.py')]
#: what people name and describe in files
FILES = [*(ROOT / 'encoder_sim').rglob('*.yaml'), *(ROOT / 'config').rglob('*.yaml'),
         *(ROOT / 'examples').rglob('*.yaml')]
SCRIPTS = list((ROOT / 'calibration' / 'report').glob('*.js'))
#: kinds of findings, a name in old logs, and what a model's file says for programs
NAMES = {*KINDS, 'as the encoders read', model_document._CONVENTION,
         model_document._CONVENTION_ON_SKY}
#: the same with something put in
BEGINNINGS = (model_document._CONVENTION_OF_AXES.partition('{')[0],)


def listed():
    """Words of the list of the style."""
    rows = re.findall(r'^\| ([^|]+) \| [^|]+ \|$', (ROOT / 'docs' / 'style.md').read_text(), re.M)
    return [word for row in rows for word in row.split(', ') if word not in ('not', '---')]


WORDS = re.compile(r'(?<![\w-])(' + '|'.join(sorted(map(re.escape, listed()), key=len)[::-1])
                   + r')(?![\w-])', re.I)


def sentences(text):
    return filter(str.strip, re.split(r'(?<=[.!?:])\s+(?=[A-Z])|(?<=[.!?])\s+|\n+', text))


def wrong(text):
    """Sentences that are too long, and words of the list, of a text."""
    out = []
    for one in sentences(text):
        count = sum(any(map(str.isalpha, word)) for word in one.replace('{}', 'x').split())
        out += [one] * (count > LONGEST) + WORDS.findall(one)
    return out


def texts(tree):
    """Texts of a source: no docstring, no pattern; what is put in is {}."""
    skipped = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            skipped.add(id(node.value))
        elif isinstance(node, ast.JoinedStr):
            skipped.update(id(part) for part in node.values)
        elif isinstance(node, ast.Call) and getattr(node.func, 'value', None) is not None \
                and getattr(node.func.value, 'id', '') == 're':
            skipped.update(map(id, ast.walk(node)))
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            yield ''.join(part.value if isinstance(part, ast.Constant) else '{}'
                          for part in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) \
                and id(node) not in skipped:
            yield node.value


class Shown(HTMLParser):
    """Text of a page: each element a line."""

    def __init__(self, page):
        super().__init__()
        self.lines, self._hidden = [], 0
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self._hidden += tag in ('style', 'script', 'head')
        if tag not in ('b', 'i', 'code', 'span', 'a'):
            self.lines.append('')

    def handle_endtag(self, tag):
        self._hidden -= tag in ('style', 'script', 'head')

    def handle_data(self, data):
        if not self._hidden:
            self.lines = [*self.lines[:-1], (self.lines or [''])[-1] + data]


def printed(parts):
    console = Console(file=StringIO(), width=300, markup=False)
    for part in parts:
        console.print(part)
    return console.file.getvalue()


# --------------------------------------------------------------------------------- what is measured

def test_a_long_sentence_and_a_listed_word_are_found():
    assert wrong('The axis leans. Stop') == ['leans']
    assert wrong(f'Short one. {"word " * 26}') == ['word ' * 26] and wrong('word ' * 25) == []
    assert {'foretold', 'in force', 'witness', 'bends', 'wander'} <= set(listed())


def test_texts_of_the_sources():
    assert len(SOURCES) > 400
    found = [(str(path.relative_to(ROOT)), bad) for path in SOURCES
             for text in texts(ast.parse(path.read_text())) if ' ' in text and text not in NAMES
             and '<' not in text and not text.startswith(BEGINNINGS) for bad in wrong(text)]
    assert found == []


def strings(value):
    """All texts of a document."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict | list):
        for part in value.values() if isinstance(value, dict) else value:
            yield from strings(part)


def test_texts_of_scenarios_and_settings():
    assert len(FILES) > 60
    found = [(path.name, bad) for path in FILES
             for document in yaml.load_all(path.read_text(), getattr(
                 yaml, 'CSafeLoader', yaml.SafeLoader))
             for text in strings(document) for bad in wrong(text)]
    assert found == []


def test_texts_of_the_scripts_of_pages():
    assert len(SCRIPTS) >= 3
    found = [(path.name, bad) for path in SCRIPTS
             for text in re.findall(r"'([^'\n]*)'", re.sub(
                 r'^\s*//.*', '', path.read_text(), flags=re.M)) if ' ' in text
             for bad in wrong(text)]
    assert found == []


def test_help_of_the_commands():
    found, parsers = [], [make_parser()]
    while parsers:
        parser = parsers.pop()
        for action in parser._actions:
            if isinstance(action, argparse._SubParsersAction):
                parsers += action.choices.values()
            found += [(parser.prog, bad) for bad in wrong((action.help or '').replace('; ', '. '))]
        found += [(parser.prog, bad) for bad in wrong(parser.description or '')]
    assert found == []


def noisy(rng, el):
    """Correlated noise of both axes."""
    steps = rng.normal(size=(2, len(el)))
    return steps + 2.0 * np.cumsum(rng.normal(size=(2, len(el))), axis=1) / len(el)**0.5


@pytest.mark.parametrize('case', ['backlash', 'drift'])
def test_page_and_terminal_of_a_diagnosis(case):
    run = night(3, 60, backlash(12.0) if case == 'backlash' else None,
                noisy if case == 'drift' else None)
    view = view_of(diagnose(run, **FAST))
    assert wrong('\n'.join(Shown(render(view)).lines)) == []
    assert wrong(printed([*summary_lines(view), *diagnosis_tables(view)])) == []


def test_page_and_terminal_of_a_fit():
    found = fit_run(night(4, 40, backlash(3.0)))
    document = fit_document(found)
    assert wrong('\n'.join(Shown(render_fit(found, document)).lines)) == []
    assert wrong(printed(fit_tables(found, document))) == []


def test_page_of_a_night():
    run, model, report = a_night()
    assert wrong('\n'.join(Shown(render_night(run, model, report)).lines)) == []
