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

Topics and services are listed in ``endpoints.json``, so the help needs neither a graph nor the
node's devices.
"""

import json
import re
import sys
import textwrap
from pathlib import Path

from . import NAMESPACE, topics

#: endings of parameter names and their units
_UNITS = (('_deg_s2', 'deg/s^2'), ('_deg_s', 'deg/s'), ('_arcsec_s', 'arcsec/s'), ('_deg', 'deg'),
          ('_arcsec', 'arcsec'), ('_hz', 'Hz'), ('_ms', 'ms'), ('_hpa', 'hPa'), ('_um', 'um'),
          ('_mb', 'MB'), ('_c', 'deg C'), ('_m', 'm'), ('_s', 's'))


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
    ends = endpoints(name)
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


def endpoints(name):
    """Topics and services of a node, as ``docs/make/nodes.py`` found them in a running one.

    Parameters
    ----------
    name : str

    Returns
    -------
    dict of str to list
        ``takes`` and ``gives``: lists of `topics.Topic`; ``services``: list of str.
    """
    every = json.loads((Path(__file__).parent / 'endpoints.json').read_text(encoding='utf-8'))
    known = {one.name: one for one in vars(topics).values() if isinstance(one, topics.Topic)}
    found = every.get(name, {'takes': [], 'gives': [], 'services': []})
    return {kind: ends if kind == 'services' else [known[end] for end in ends]
            for kind, ends in found.items()}
