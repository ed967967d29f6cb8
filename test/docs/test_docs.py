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

"""The documentation holds together: links, pages and tables that are made, index, length."""

import re
import runpy
import sys

import pytest
from places import ROOT

DOCS = ROOT / 'docs'
PAGES = sorted([*ROOT.glob('*.md'), *DOCS.rglob('*.md'), ROOT / 'calibration/data/README.md'])
LINK = re.compile(r'(?<!\\)\[[^\]\[]*(?:\[[^\]]*\][^\]\[]*)*\]\(<?([^)\s>]+)>?(?:\s+"[^"]*")?\)')


@pytest.fixture
def made(monkeypatch):
    """The scripts that make pages and pictures."""
    monkeypatch.syspath_prepend(str(DOCS / 'make'))
    yield
    for name in ('nodes', 'drawings', 'effects', 'tables'):
        sys.modules.pop(name, None)


def text_of(path):
    """A page without its blocks of code."""
    return re.sub(r'^(```|~~~).*?^\1', '', path.read_text(encoding='utf-8'), flags=re.M | re.S)


def links_of(text):
    """Targets of the links and pictures of a page."""
    plain = re.sub(r'`[^`\n]*`', lambda code: re.sub(r'[\[\]()]', ' ', code.group()), text)
    return LINK.findall(plain) + re.findall(r'<img[^>]* src="([^"]+)"', plain)


def anchors_of(text):
    """What a link may name in a page: its headings as GitHub and the site spell them."""
    found = []
    for heading in re.findall(r'^#{1,6}\s+(.+?)\s*#*$', text, flags=re.M):
        heading = re.sub(r'\[([^\]]*)\]\([^)]*\)', r'\1', heading)
        slug = re.sub(r'[^\w\- ]', '', heading.lower()).replace(' ', '-')
        found.append(slug if slug not in found else f'{slug}-{found.count(slug)}')
    return found


def broken(path, text=None):
    """Links of a page that lead nowhere."""
    wrong = []
    for link in links_of(text_of(path) if text is None else text):
        if re.match(r'[a-z]+:', link):
            continue
        name, _, anchor = link.partition('#')
        target = (path.parent / name).resolve() if name else path
        there = target.exists() and ROOT in target.parents
        if there and anchor:
            there = anchor in anchors_of(text_of(target) if text is None or name else text)
        if not there:
            wrong.append(link)
    return wrong


def test_every_link_leads_somewhere():
    wrong = {str(path.relative_to(ROOT)): broken(path) for path in PAGES}
    assert {path: links for path, links in wrong.items() if links} == {}


def test_a_broken_link_is_found():
    page = DOCS / 'index.md'
    text = '# A *b*, c\n[x](nowhere.md) [y](#a-b-c) [z](#d) ![p](pictures/no.svg) [w](../README.md)'
    assert broken(page, text) == ['nowhere.md', '#d', 'pictures/no.svg']


def test_every_page_is_in_the_navigation_of_the_site():
    """Which docs/conf.py makes of the lists in the index and in that of the nodes."""
    navigation = runpy.run_path(str(DOCS / 'conf.py'))['navigation']
    entries = set()
    for name in ('docs/index', 'docs/nodes/index'):
        source = [(ROOT / f'{name}.md').read_text(encoding='utf-8')]
        navigation(None, name, source)
        entries |= {ROOT / f'{entry}.md' for entry in re.findall(
            r'^/([\w/.-]+)$', source[0], flags=re.M)}
    assert set(DOCS.rglob('*.md')) - entries == {DOCS / 'index.md'}
    assert ROOT / 'CONTRIBUTING.md' in entries


def test_pages_of_the_nodes_are_those_that_the_script_makes(made, ros_domain, tmp_path):
    """`python docs/make/nodes.py` writes them again."""
    import nodes
    for path, text in nodes.pages(nodes.declared(tmp_path)).items():
        assert (DOCS / path).read_text(encoding='utf-8') == text, path
    from telescope_mount.graph import NODES
    assert {path.stem for path in (DOCS / 'nodes').glob('*.md')} == {*NODES, 'index'}


def test_pictures_are_those_that_the_script_makes(made):
    """`python docs/make/drawings.py` writes them again."""
    import drawings
    for name, text in drawings.pages().items():
        assert (DOCS / 'pictures' / name).read_text(encoding='utf-8') == text, name


def test_the_list_of_causes_is_that_of_the_dictionary(made):
    """`python docs/make/effects.py` writes it again."""
    import effects
    assert (DOCS / 'effects.md').read_text(encoding='utf-8') == effects.page()


def test_every_table_that_is_made_stands_between_its_marks(made):
    import tables
    found = [(match['name'], page.name) for page in sorted(DOCS.rglob('*.md'))
             for match in tables.MARK.finditer(page.read_text(encoding='utf-8'))]
    assert sorted(found) == sorted((name, table.page) for name, table in tables.TABLES.items())


def test_a_table_is_what_its_command_prints(made):
    """`python docs/make/tables.py fit_mmt` writes it again."""
    import tables
    page = (DOCS / 'your_own_file.md').read_text(encoding='utf-8')
    text = next(match['text'] for match in tables.MARK.finditer(page) if match['name'] == 'fit_mmt')
    assert text == tables.output_of(tables.TABLES['fit_mmt']) + '\n'


def test_a_table_is_stale_where_code_changed_and_not_where_words_did(made, tmp_path, monkeypatch):
    import tables
    monkeypatch.setattr(tables, 'ROOT', tmp_path)
    monkeypatch.setattr(tables, 'DOCS', tmp_path)
    monkeypatch.setattr(tables, 'TABLES', {
        'one': tables.Table('page.md', 'telescope-mount fit a.csv', ('part',))})
    code = tmp_path / 'part' / 'code.py'
    code.parent.mkdir()

    def stale(text):
        code.write_text(text)
        tables.hash_of.cache_clear()
        return tables.stale()
    assert stale('def f():\n    """Words."""\n    return 1\n') == ['one']  # not there
    rests = tables.rests_on(('part',))
    (tmp_path / 'page.md').write_text(
        f'<!-- made: one; rests on {rests}; commit 0, a machine -->\n1\n<!-- end: one -->\n')
    assert stale('def f():\n    """Other words."""\n    return 1  # why\n') == []
    assert stale('def f():\n    return 2\n') == ['one']


def prose_of(path):
    """Sentences and cells of a page as a reader counts their words; code is one word."""
    text = re.sub(r'<!--.*?-->', '', text_of(path), flags=re.S)
    text = re.sub(r'^!.*|^    .*', '', text, flags=re.M)
    text = re.sub(r'\[([^\]]*)\]\([^)]*\)', r'\1', re.sub(r'`[^`\n]*`(?:, )?', 'code ', text))
    for part in re.split(r'\n\s*\n|\n(?=- |\d+\. |#)|(?<!\\)\|', text):
        yield from re.split(r'(?<=[.!?:;])\s+', ' '.join(part.split()))


def test_sentences_are_short():
    """25 words; formulas and what the nodes declare are not counted."""
    long = {path.name: found for path in [*ROOT.glob('*.md'), *DOCS.glob('*.md')]
            if (found := [text for text in prose_of(path)
                          if len(re.findall(r'\w*[^\W\d_]\w*', text)) > 25])}
    assert long == {}


def test_words_of_the_style_are_not_in_the_documentation():
    """The glossary explains some of them."""
    style = DOCS / 'style.md'
    if not style.exists():
        pytest.skip('no docs/style.md')
    rows = re.findall(r'^\| ([^|]+) \| [^|]+ \|$', style.read_text(encoding='utf-8'), re.M)
    listed = [word for row in rows for word in row.split(', ') if word not in ('not', '---')]
    words = re.compile(rf'(?<![\w-])({"|".join(map(re.escape, listed))})(?![\w-])', re.I)
    made = ('style.md', 'glossary.md', 'effects.md', 'topics.md')
    found = {path.name: words.findall(' '.join(prose_of(path))) for path in [
        ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', *DOCS.glob('*.md')] if path.name not in made}
    assert {name: words for name, words in found.items() if words} == {}


def test_the_documentation_is_no_longer_than_people_read():
    pages = [ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', *DOCS.glob('*.md'),
             *DOCS.glob('nodes/*.md')]
    assert sum(len(path.read_text(encoding='utf-8').split()) for path in pages) <= 45_000


def test_the_keywords_of_the_tutorial_are_a_mapping():
    from pointing_model.runs.plate_solves.frames import ICRS
    from pointing_model.runs.plate_solves.mapping import load_mapping
    mapping = load_mapping(ROOT / 'examples' / 'tutorial' / 'mount.yaml')
    assert mapping.needed == ('time', 'ra_enc_deg', 'dec_enc_deg') and mapping.readings == ICRS


def test_a_mount_is_drawn_as_the_geometry_turns_it(made):
    import drawings
    for name in ('CA', 'NPAE', 'AN', 'AW', 'CH', 'NP', 'MA', 'ME'):
        assert drawings.skeleton_error(name) < 1e-9
    skeleton = drawings.Skeleton('altaz', {'AN': 0.1}).sight()
    assert abs(skeleton[1] - drawings.Skeleton('altaz', {}).sight()[1]).max() > 0.01


def test_the_sample_night_is_small_and_can_be_fitted():
    from telescope_mount import fit, read_run
    folder = ROOT / 'examples' / 'night'
    assert sum(path.stat().st_size for path in folder.rglob('*') if path.is_file()) < 900_000
    found = fit(read_run(folder / 'bag'))
    assert len(found.run) == 60 and found.rms_left_out_arcsec < 1.6
    # the mount that docs/first_night.md observes: scenario default
    assert abs(found.terms_arcsec['AN'] - 37.0) < 1.0


def test_the_glossary_has_every_term_of_every_mount():
    from pointing_model.mount_kinds import KINDS
    from pointing_model.pointing_terms import terms_of
    text = (DOCS / 'glossary.md').read_text(encoding='utf-8')
    named = set(re.findall(r'\*\*([A-Z0-9]+)\*\*', text))
    wanted = {name for kind in KINDS for name in terms_of(kind)}
    assert wanted - named == set()


def test_the_reliability_of_each_topic_is_told_as_it_is():
    pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)
    from rclpy.qos import ReliabilityPolicy

    from msg_tools import topics
    rows = {row.split('`')[1]: row for row in (DOCS / 'topics.md').read_text().splitlines()
            if row.startswith('| `')}
    for topic in (value for value in vars(topics).values() if isinstance(value, topics.Topic)):
        best_effort = topic.qos.reliability == ReliabilityPolicy.BEST_EFFORT
        assert ('| best effort, ' in rows[topic.name]) == best_effort, topic.name
        assert ('| reliable, ' in rows[topic.name]) != best_effort, topic.name
