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

"""``NODE --help``: purpose, parameters, topics and services of a node, without starting it.

Topics and services are read from the source of the node and its helpers, so the help needs
neither a graph nor the node's devices.
"""

import ast
import re
import sys
import textwrap
from importlib import import_module
from pathlib import Path

from . import NAMESPACE, topics

#: endings of parameter names and their units
_UNITS = (('_deg_s2', 'deg/s^2'), ('_deg_s', 'deg/s'), ('_arcsec_s', 'arcsec/s'), ('_deg', 'deg'),
          ('_arcsec', 'arcsec'), ('_hz', 'Hz'), ('_ms', 'ms'), ('_hpa', 'hPa'), ('_um', 'um'),
          ('_mb', 'MB'), ('_c', 'deg C'), ('_m', 'm'), ('_s', 's'))
#: modules with endpoints that every node has
_SHARED = (('msg_tools', 'node'), ('msg_tools', 'parameters'))
_VERBS = {'publisher': 'gives', 'subscribe': 'takes'}


def wants_help(args):
    """Whether a user asks for help: ``--help`` or ``-h`` before the ROS arguments.

    Parameters
    ----------
    args : list of str
        Command line without the name of the program.
    """
    own = args[:args.index('--ros-args')] if '--ros-args' in args else args
    return '--help' in own or '-h' in own


def node_help(node_class):
    """Help text of a node.

    Parameters
    ----------
    node_class : type
        Class of the node; its module has the parameters as `PARAMS`, and a docstring.

    Returns
    -------
    str
    """
    module = sys.modules[node_class.__module__]
    name = Path(module.__file__).stem.removesuffix('_node')
    lines = [f'usage: ros2 run telescope_mount {name} --ros-args [-p PARAMETER:=VALUE ...] '
             f'[-r __ns:=/NAME] [--params-file FILE]', '', *_paragraphs(module.__doc__)]
    ends = endpoints(node_class)
    for verb in ('takes', 'gives'):
        rows = [(topic.name, topic.type) for topic in ends[verb]]
        lines += _block(f'topics that it {verb} (relative to {NAMESPACE}):', rows)
    lines += _block('services:', [(service, '') for service in ends['services']])
    params = getattr(node_class, 'PARAMS', None) or vars(module).get('PARAMS', ())
    lines += _block('parameters:', [(param.name, _described(param)) for param in params])
    return '\n'.join(lines).rstrip() + '\n'


def _paragraphs(text):
    for part in (text or '').strip().split('\n\n'):
        yield from textwrap.wrap(' '.join(part.split()), 79)
        yield ''


def _block(title, rows):
    if not rows:
        return []
    out = [title]
    for name, text in rows:
        wrapped = textwrap.wrap(text, 79 - 26) or ['']
        if len(name) > 23:
            out.append(f'  {name}')
        else:
            out.append(f'  {name:<24}{wrapped.pop(0)}'.rstrip())
        out += [' ' * 26 + line for line in wrapped]
    return [*out, '']


def _described(param):
    """Description, unit, range and default of a parameter."""
    unit = re.findall(r'\[([^\]]+)\]', param.doc)
    unit = unit[-1] if unit else next(
        (unit for end, unit in _UNITS if param.name.endswith(end)), '')
    limits = ' or '.join(f"'{choice}'" for choice in param.choices)
    if param.low is not None:
        limits = ' to '.join(f'{v:g}' if isinstance(param.default, float) else str(v)
                             for v in (param.low, param.high))
    default = ', '.join(map(str, param.default)) if isinstance(
        param.default, list | tuple) else param.default
    default = str(default).lower() if isinstance(default, bool) else default
    default = 'default: empty' if default == '' else f'default {default}'
    facts = [f'{limits} {unit}'.strip(), default, 'only at the start' if param.fixed else '']
    return re.sub(r'\s*\[[^\]]+\]', '', param.doc) + f' ({", ".join(filter(None, facts))})'


# --- from the source -----------------------------------------------------------------------------


def endpoints(node_class):
    """Topics and services that the source of a node creates.

    Parameters
    ----------
    node_class : type

    Returns
    -------
    dict of str to list
        ``takes`` and ``gives``: lists of `topics.Topic`; ``services``: list of str.
    """
    found = {'takes': {}, 'gives': {}, 'services': {}}
    scanned = set()
    for base in node_class.__mro__:
        name = base.__module__
        if name == '__main__':  # started with ``python -m``
            name = sys.modules[name].__spec__.name
        house, _, part = name.partition('.')
        if part and house != 'rclpy' and (house, part) not in _SHARED:
            _scan(name, found, scanned)
    return {'takes': sorted(found['takes'].values(), key=lambda t: t.name),
            'gives': sorted(found['gives'].values(), key=lambda t: t.name),
            'services': sorted(found['services'])}


def _scan(name, found, scanned):
    """Search a module, and those of the same package that create endpoints for the node."""
    if name in scanned:
        return
    scanned.add(name)
    tree = ast.parse(Path(import_module(name).__file__).read_text(encoding='utf-8'))
    constants = {target.id: item.value for item in tree.body if isinstance(item, ast.Assign)
                 for target in item.targets if isinstance(target, ast.Name)}
    for function in ast.walk(tree):
        if isinstance(function, ast.FunctionDef):
            loops = {name.id: loop.iter for loop in ast.walk(function)
                     if isinstance(loop, ast.For | ast.comprehension)
                     for name in ast.walk(loop.target)
                     if isinstance(name, ast.Name)}
            for call in ast.walk(function):
                if isinstance(call, ast.Call):
                    _take(call, {**constants, **loops}, found)
    for item in tree.body:
        if isinstance(item, ast.ImportFrom):
            house = name.split('.')[0]
            other = f'{house}.{item.module}' if item.level else item.module
            helper = other and other.split('.')[0] in (house, 'pointing_model', 'encoder_reading')
            if helper and not other.endswith('_node') and _has_node(other):
                _scan(other, found, scanned)


def _has_node(name):
    """Whether a module has functions that create endpoints of a node."""
    try:
        source = Path(import_module(name).__file__).read_text(encoding='utf-8')
    except (ImportError, OSError):
        return False
    return 'node.publisher(' in source or 'node.subscribe(' in source


def _take(call, known, found):
    made = call.func
    if not (isinstance(made, ast.Attribute) and isinstance(made.value, ast.Name)
            and made.value.id in ('self', 'node') and call.args):
        return
    if made.attr in _VERBS:
        for topic in _topics(call.args[0], known):
            found[_VERBS[made.attr]][topic.name] = topic
    elif made.attr in ('serve', 'create_service'):
        for text in _texts(call.args[made.attr == 'create_service'], known):
            found['services'][text] = None


def _topics(node, known):
    if isinstance(node, ast.Name) and node.id in known:
        node = known[node.id]
    for part in ast.walk(node):
        if isinstance(part, ast.Attribute) and isinstance(part.value, ast.Name) and (
                part.value.id == 'topics'):
            topic = getattr(topics, part.attr, None)
            if isinstance(topic, topics.Topic):
                yield topic


def _texts(node, known):
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        yield node.value
    elif isinstance(node, ast.JoinedStr):  # '~/' and a name
        for text in _texts(node.values[-1].value, known):
            yield node.values[0].value + text
    elif isinstance(node, ast.Attribute):  # the name of a function
        yield from _texts(node.value, known)
    elif isinstance(node, ast.Name) and isinstance(known.get(node.id), ast.Tuple):
        for row in known[node.id].elts:
            first = row.elts[0] if isinstance(row, ast.Tuple) else row
            if isinstance(first, ast.Attribute):
                yield first.attr
            elif isinstance(first, ast.Constant) and isinstance(first.value, str):
                yield first.value
