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

"""Message definitions, type hashes and quality of service in the form of rosbag2 logs."""

import importlib.util
import json
import os
import re
import sys
from functools import cache
from pathlib import Path

import yaml

try:
    from yaml import CSafeDumper as _Dumper
    from yaml import CSafeLoader as Loader
except ImportError:  # PyYAML built without libyaml
    from yaml import SafeDumper as _Dumper
    from yaml import SafeLoader as Loader

#: limits for the contents of a foreign channel
MAX_QOS_TEXT, MAX_PROFILES, MAX_NESTING = 65536, 100, 20
_SEPARATOR = '=' * 80
_PRIMITIVES = frozenset((
    'bool', 'byte', 'char', 'float32', 'float64', 'int8', 'uint8', 'int16', 'uint16', 'int32',
    'uint32', 'int64', 'uint64', 'string', 'wstring',
))
_INFINITE = {'sec': 9223372036, 'nsec': 854775807}
# names by the numbers of rmw/types.h, used by metadata before version 9
_POLICIES = {
    'history': ('system_default', 'keep_last', 'keep_all', 'unknown'),
    'reliability': ('system_default', 'reliable', 'best_effort', 'unknown', 'best_available'),
    'durability': ('system_default', 'transient_local', 'volatile', 'unknown', 'best_available'),
    'liveliness': (
        'system_default', 'automatic', 'manual_by_node', 'manual_by_topic', 'unknown',
        'best_available',
    ),
}
_DURATIONS = ('deadline', 'lifespan', 'liveliness_lease_duration')
#: in the order of metadata version 9
_QOS_DEFAULT = {
    'history': 'keep_last', 'depth': 10, 'reliability': 'reliable', 'durability': 'volatile',
    'deadline': _INFINITE, 'lifespan': _INFINITE, 'liveliness': 'automatic',
    'liveliness_lease_duration': _INFINITE, 'avoid_ros_namespace_conventions': False,
}


def _prefixes(package):
    """Folders that may hold ``share/<package>``: the ament index first, then the wheels."""
    found = [p for p in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep) if p]
    found.append(sys.prefix)
    try:
        spec = importlib.util.find_spec(package)
    except (ImportError, ValueError):
        spec = None
    for folder in (spec.submodule_search_locations or ()) if spec else ():
        # <prefix>/lib/python3.x/site-packages/<package>
        parents = Path(folder).parents
        if len(parents) > 3:
            found.append(str(parents[3]))
    return tuple(dict.fromkeys(found))


def split_type(type_name):
    match = re.fullmatch(r'([A-Za-z]\w*)/(?:msg/)?([A-Za-z]\w*)', type_name)
    if match is None:
        raise ValueError(
            f'message type {type_name!r} is not of the form package/msg/Type')
    return match.groups()


def _read_share(type_name, suffix):
    """Text of a file installed with a message type, or None."""
    package, name = split_type(type_name)
    for prefix in _prefixes(package):
        file = Path(prefix, 'share', package, 'msg', name + suffix)
        if file.is_file():
            return file.read_text(encoding='utf-8')
    return None


def _dependencies(text, package):
    found = set()
    for line in text.splitlines():
        line = line.split('#', 1)[0].strip()
        if not line:
            continue
        kind = re.match(r'[\w/]+', line)
        kind = kind.group() if kind else ''
        if kind and kind not in _PRIMITIVES:
            found.add(kind if '/' in kind else f'{package}/{kind}')
    return sorted(found)


@cache
def message_definition(type_name):
    """Full text of a message definition: the type, then all its dependencies.

    Parameters
    ----------
    type_name : str
        ``package/msg/Type``.

    Returns
    -------
    str
        The ``ros2msg`` schema as rosbag2 writes it: every dependency once, after a line of 80
        ``=`` and a line ``MSG: package/Type``.

    Raises
    ------
    ValueError
        The type or a dependency is not installed.
    """
    included = set()

    def full(name):
        package, short_name = split_type(name)
        text = _read_share(name, '.msg')
        if text is None:
            raise ValueError(
                f'message type {name}: no share/{package}/msg/{short_name}.msg found; install or '
                f'source the package {package}')
        for dependency in _dependencies(text, package):
            if dependency not in included:
                included.add(dependency)
                text += f'\n{_SEPARATOR}\nMSG: {dependency}\n{full(dependency)}'
        return text

    return full(type_name)


@cache
def type_hash(type_name):
    """RIHS01 hash of a message type, from its installed package.

    In a running graph, endpoints provide it (`TopicEndpointInfo.topic_type_hash`).

    Parameters
    ----------
    type_name : str
        See `message_definition`.

    Returns
    -------
    str
        ``RIHS01_...``; empty if the package has none (before ROS 2 Iron), as in rosbag2.
    """
    text = _read_share(type_name, '.json')
    entries = json.loads(text)['type_hashes'] if text else ()
    full_name = '{}/msg/{}'.format(*split_type(type_name))
    return next((e['hash_string'] for e in entries if e['type_name'] == full_name), '')


def qos_dict(profile):
    """A QoS profile as in metadata version 9: names as strings, durations in sec and nsec.

    Parameters
    ----------
    profile : dict or rclpy QoSProfile
        Keys may be missing in a dict; policies are strings, enum members or rmw numbers, durations
        ``{'sec', 'nsec'}``, nanoseconds or objects with ``nanoseconds``.

    Returns
    -------
    dict

    Raises
    ------
    ValueError
        A policy is unknown.
    """
    out = {}
    for key, default in _QOS_DEFAULT.items():
        value = profile.get(key) if isinstance(profile, dict) else getattr(profile, key, None)
        if value is None:
            value = default
        if key in _POLICIES:
            names = _POLICIES[key]
            # enum members of rclpy are ints too: use the name
            text = value if isinstance(value, str) else getattr(value, 'name', None)
            if text is None and isinstance(value, int) and 0 <= value < len(names):
                text = names[value]
            text = str(text if text is not None else value).lower()
            if text not in names:
                raise ValueError(
                    f'QoS {key} {value!r} is unknown; use one of {", ".join(names)}')
            out[key] = text
        elif key in _DURATIONS:
            if isinstance(value, dict):
                out[key] = {'sec': int(value['sec']), 'nsec': int(value['nsec'])}
            else:
                sec, nsec = divmod(int(getattr(value, 'nanoseconds', value)), 10**9)
                out[key] = {'sec': sec, 'nsec': nsec}
        else:
            out[key] = type(default)(value)
    return out


class _PlainDumper(_Dumper):
    """Writes no anchors: yaml-cpp writes none, and equal durations are not references."""

    def ignore_aliases(self, data):
        return True


def dump_yaml(document):
    """YAML in the format of rosbag2."""
    return yaml.dump(
        document, Dumper=_PlainDumper, default_flow_style=False, sort_keys=False, width=10**6)


def load_qos(text):
    """List of `qos_dict` from the YAML text of a channel.

    Raises
    ------
    ValueError
        The text is not a list of QoS profiles.
    """
    if len(text) > MAX_QOS_TEXT:
        raise ValueError(f'QoS text of {len(text)} characters')
    try:
        level = 0
        for event in yaml.parse(text, Loader=Loader):
            level += isinstance(event, yaml.CollectionStartEvent)
            level -= isinstance(event, yaml.CollectionEndEvent)
            if level > MAX_NESTING:  # the loader of libyaml would crash
                raise ValueError(f'YAML nested more than {MAX_NESTING} deep')
            if isinstance(event, yaml.ScalarEvent) and event.value == '<<':
                raise ValueError('YAML with a merge key')  # a few lines could fill the memory
        profiles = yaml.load(text, Loader=Loader) or []
    except Exception as error:  # foreign text can raise anything
        raise ValueError(' '.join(str(error).split())[:120]) from None
    if not isinstance(profiles, list) or not all(isinstance(p, dict) for p in profiles):
        raise ValueError('QoS text is no list of profiles')
    try:
        return [qos_dict(profile) for profile in profiles[:MAX_PROFILES]]
    except (KeyError, TypeError, OverflowError, AttributeError) as error:
        raise ValueError(f'QoS profile with {error!r}') from None
