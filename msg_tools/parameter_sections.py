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

"""Sections of a ROS parameter file, and the nodes that they match.

ROS ignores a section that matches no node. Names match as in `rclcpp::parameter_map_from`.
"""

import re
from difflib import get_close_matches
from pathlib import Path

import yaml

PARAMETERS = 'ros__parameters'
EXAMPLE = 'config/site.yaml is one to copy'
#: a name this similar to that of a node is a misspelling
ALIKE = 0.85


class _Pairs(list):
    """Key-value pairs, including repeated keys."""


class _Loader(yaml.SafeLoader):
    """Makes `_Pairs` of mappings, so repeated sections are all used."""


_Loader.add_constructor('tag:yaml.org,2002:map', lambda loader, node: _Pairs(
    (loader.construct_object(key, True), loader.construct_object(value, True))
    for key, value in node.value))


def sections(path):
    """Parameters by the name of their section.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    dict of str to dict

    Raises
    ------
    ValueError
        Not a parameter file.
    """
    try:
        document = yaml.load(Path(path).read_text(encoding='utf-8'), _Loader)
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ValueError(f'{path} is no YAML ({" ".join(str(error).split())[:100]}); '
                         f'{EXAMPLE}') from None
    if not isinstance(document, _Pairs | None):
        raise ValueError(f'{path} holds no parameters; {EXAMPLE}')
    found = {}
    _gather(path, document or (), '', found)
    return found


def _gather(path, pairs, space, found):
    for key, value in pairs:
        name = f'{space.rstrip("/")}/{key}' if space else str(key)
        if not isinstance(value, _Pairs):
            raise ValueError(f'{path}: {name} is empty, or not below {PARAMETERS} of a node; '
                             f'{EXAMPLE}')
        if key == PARAMETERS:
            found.setdefault(space, {}).update(value)
        else:
            _gather(path, value, name, found)


def is_of(section, node):
    """Whether a section matches the full name of a node."""
    pattern = '/' + section.removeprefix('/')
    return re.fullmatch(pattern.replace('/*', r'(/\w+)'), node) is not None


def check_files(node, words):
    """Refuse parameter files intended for a node that do not match it.

    Parameters
    ----------
    node : str
        Its full name.
    words : list of str
        Words of its command line.

    Raises
    ------
    ValueError
        A section without a namespace, or with a name misspelt, and no other one for it.
    """
    name = node.rpartition('/')[2]
    for option, path in zip(words, words[1:]):
        if option != '--params-file':
            continue
        try:
            found = sections(path)
        except (ValueError, OSError):  # as rcl says, or a file of launch with tuples of Python
            continue
        meant = [section for section in found
                 if get_close_matches(section.rpartition('/')[2], [name], 1, ALIKE)]
        wrong = [section for section in meant
                 if section == name or not section.endswith(f'/{name}')]
        if wrong and not any(is_of(section, node) for section in meant):
            raise ValueError(f'{path}: section {wrong[0]} does not match {node}: write /**/{name}')
