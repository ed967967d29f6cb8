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

"""Parameter files: what they set of which node, and what is refused before a node is started."""

import re

import pytest
from places import ROOT

from msg_tools.parameter_sections import check_files, sections
from telescope_mount.graph import night_graph, real_graph
from telescope_mount.input_files.parameter_file import check, values_of
from telescope_mount.nights.whole_night import run_night

PLACE = {'latitude_deg': 34.3, 'longitude_deg': 109.0, 'height_m': 500.0}
SITE = '/**: {ros__parameters: {latitude_deg: 34.3, longitude_deg: 109.0, height_m: 500.0}}\n'
GUARD = 'mount_guard: {ros__parameters: {least_elevation_deg: 50.0}}\n'


@pytest.fixture
def file(tmp_path):
    """``file(text)``: the path of a parameter file."""
    path = tmp_path / 'mine.yaml'
    return lambda text: path.write_text(text) and path


# each as rclpy of Jazzy has it
@pytest.mark.parametrize('text, value', [
    ('/**: {P: {a: 1}}\n/**/mount_guard: {P: {a: 2}}', 2),
    ('/**/mount_guard: {P: {a: 2}}\n/**: {P: {a: 1}}', 1),
    ('/**: {P: {a: 1}}\n/mount/mount_guard: {P: {a: 2}}', 1),  # the graph names this one first
    ('/*/mount_guard: {P: {a: 2}}', 2), ('/mount/*: {P: {a: 3}}', 3), ('/*: {P: {a: 3}}', 0),
    ('mount: {mount_guard: {P: {a: 5}}}', 5), ('mount/mount_guard: {P: {a: 6}}', 6),
    ('mount_guard: {P: {a: 7}}', 0), ('/**: {mount_guard: {P: {a: 8}}}', 8),
    ('mount/: {mount_guard: {P: {a: 9}}}', 9), ('/**: {P: {a: 1}}\n/**: {P: {b: 2}}', 1),
])
def test_what_a_node_has_of_a_file(file, text, value):
    found = sections(file(text.replace('P:', 'ros__parameters:')))
    assert values_of('/mount/mount_guard', {'a': 0}, found)['a'] == value


@pytest.mark.parametrize('text, words', [
    ('a: [', 'is no YAML'), ('- 1', 'holds no parameters'),
    ('/**/mount_guard: {a: 1}', '/**/mount_guard/a is empty, or not below ros__parameters'),
    ('/**/mount_guard: {ros_parameters: {a: 1}}', '/**/mount_guard/ros_parameters/a is empty, or'),
    ('/**: {ros__parameters: }', '/**/ros__parameters is empty, or'),
])
def test_what_is_no_parameter_file(file, text, words):
    with pytest.raises(ValueError, match=re.escape(words) + '.*config/site.yaml is one to copy'):
        sections(file(text))


@pytest.mark.parametrize('section, hint', [
    (GUARD, 'write /**/mount_guard. The'), (GUARD.replace('mount', '/**/mount', 1).replace(
        'guard', 'gard', 1), 'write /**/mount_guard. The'),
    (f'/north/{GUARD}', 'write /**/mount_guard. The'), (f'/*/*/{GUARD}', 'write /**/mount_guard.'),
    ('/north/**: {ros__parameters: {a: 1}}', 'The'),
])
def test_a_section_that_matches_no_node_is_refused_with_the_nodes(file, section, hint):
    name, path = section.partition(': ')[0], file(SITE + section)
    for specs in night_graph(bag='b'), real_graph(bag='b'):
        with pytest.raises(ValueError, match=re.escape(
                f'{path}: section {name} matches no node in /mount: {hint}')) as refused:
            check(specs, path)
        assert str(refused.value).endswith(', '.join(spec.name for spec in specs))


def test_a_node_lets_sections_of_others_be(file):
    other = '/south/mount_guard: {ros__parameters: {least_elevation_deg: 50.0}}\n'
    for text in (SITE, other, GUARD + f'/**/{GUARD}', other.replace('mount_guard', 'camera')):
        check_files('/north/mount_guard', ['--params-file', str(file(text)), '--params-file'])
    check_files('/mount_guard', ['--params-file', str(file(GUARD))])
    # what ROS launch writes
    tuples = '/mount/mcap_logger: {ros__parameters: {exclude: !!python/tuple [a, b]}}'
    check_files('/mount/mcap_logger', ['--params-file', str(file(tuples))])


def test_sections_of_other_nodes_and_of_drivers(file):
    there = file(f'{SITE}/**/frame_reader: {{ros__parameters: {{heads: 1}}}}\n'
                 '/*/indi_mount: {ros__parameters: {port: 1}}\n')
    assert check(night_graph(bag='b'), there) == check(real_graph(bag='b'), there) == []
    path = file(SITE + '/**/my_dome: {ros__parameters: {slit_m: 2.0}}\n')
    with pytest.raises(ValueError, match='section /../my_dome matches no node'):
        check(night_graph(bag='b'), path)
    assert check(real_graph(bag='b'), path) == check(night_graph(bag='b'), path, ['dome.py']) == [
        f'{path}: section /**/my_dome matches no node here; a driver of that name may read it']
    for name in ('config/site.yaml', 'examples/toy_telescope.yaml'):
        assert check(real_graph(bag='b'), ROOT / name) == []


def test_guard_and_observer_have_one_site(file):
    assert check(night_graph(bag='b')) == check(night_graph(bag='b', time_scale=1.0)) == []
    assert check(real_graph(bag='b', sky=PLACE)) == []
    with pytest.raises(ValueError, match='^no site for mount_guard and star_observer: set lat'):
        check(real_graph(bag='b'))
    path = file('/**/mount_guard: {ros__parameters: {latitude_deg: -31.0, longitude_deg: -70.0}}')
    with pytest.raises(ValueError, match='^no site for star_observer: set latitude_deg'):
        check(real_graph(bag='b'), path)
    for specs in (night_graph(bag='b'), night_graph(bag='b', time_scale=1.0),
                  real_graph(bag='b', sky=PLACE)):
        with pytest.raises(ValueError, match=re.escape(
                'the nodes mount_guard (-31.0000, -70.0000 deg) and star_observer (34.3000, '
                f'109.0000 deg) have different sites: set one for all, under /**: in {path}')):
            check(specs, path)
    # a guard without a site says itself whether it needs one
    assert check(real_graph(bag='b'), file(SITE.replace('/**', '/**/star_observer'))) == []
    # a longitude of the other sign of counting is the same
    assert check(real_graph(bag='b', sky=PLACE), file(
        '/**/mount_guard: {ros__parameters: {longitude_deg: -251.0}}')) == []


def test_the_refraction_is_of_the_height_of_the_site(file):
    high = PLACE | {'height_m': 2400.0}
    assert check(real_graph(bag='b', sky=high)) == []
    assert check(real_graph(bag='b', sky=high), file('/**: {ros__parameters: {pressure_hpa: 1015.}}'
                                                     )) == [
        'pressure 1015 hPa, but 756 hPa is usual at a height of 2400 m. Give the pressure at the '
        'mount, not reduced to sea level']
    del high['height_m']
    note, = check(real_graph(bag='b', sky=high))
    assert note.startswith('no height of the site: refraction is computed for 500 m. Set height_m ')
    assert check(real_graph(bag='b', sky=high | {'pressure_hpa': 756.0})) == []


def test_a_night_is_refused_before_its_folder_is_made(file, tmp_path, monkeypatch):
    monkeypatch.setattr('telescope_mount.nights.whole_night.observe', None)
    with pytest.raises(ValueError, match='section mount_guard matches no node'):
        run_night(tmp_path / 'n', params_file=file(GUARD))
    assert not (tmp_path / 'n').exists()
