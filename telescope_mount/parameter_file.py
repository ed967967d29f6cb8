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

"""A ROS parameter file of the user's: of which nodes it is, and where it places them.

Of sections that match, the last holds, by where each name stands first in all files.
"""

from difflib import get_close_matches

from msg_tools import NAMESPACE
from msg_tools.parameter_sections import ALIKE, is_of, sections

from .graph import NODES, WITH_BUILT_TYPES, simulated_site

#: nodes that move a mount; in a graph without one there are drivers, whose names nobody knows
MOUNTS = ('mount_simulator', 'indi_mount', 'alpaca_mount')
GUARD, OBSERVER = 'mount_guard', 'star_observer'


def values_of(node, parameters, found):
    """What a node has at its start.

    Parameters
    ----------
    node : str
        Its full name.
    parameters : dict
        Those of the graph.
    found : dict
        As of `sections`.

    Returns
    -------
    dict
    """
    merged = {node: dict(parameters)}
    for section, more in found.items():
        merged.setdefault(section, {}).update(more)
    return {name: value for section, values in merged.items() if is_of(section, node)
            for name, value in values.items()}


def check(specs, path=None, drivers=(), namespace=NAMESPACE):
    """Refuse what would leave a node without its parameters, or two nodes at two places.

    Parameters
    ----------
    specs : list of graph.NodeSpec
        The nodes that will be started.
    path : str or Path, optional
        The parameter file; without it the graph's own values alone are checked.
    drivers : sequence
        That will be started beside them.
    namespace : str
        In which they will be.

    Returns
    -------
    list of str
        Which sections only a driver can read.

    Raises
    ------
    ValueError
        A section is of no node, or the nodes have no site or two.
    """
    found, namespace = sections(path) if path else {}, f'/{namespace.strip("/")}'.rstrip('/')
    names = [spec.name for spec in specs]
    driven = bool(drivers) or not any(name in MOUNTS for name in names)
    notes = [_note(path, section, names, driven, namespace) for section in found]
    _check_site({spec.name: (spec, values_of(f'{namespace}/{spec.name}', spec.parameters, found))
                 for spec in specs}, path)
    return list(filter(None, notes))


def _note(path, section, names, driven, namespace):
    """'' for a section of a node of this project; ValueError for one that nobody can read."""
    known = list(dict.fromkeys([*names, *NODES, *WITH_BUILT_TYPES]))
    if any(is_of(section, f'{namespace}/{name}') for name in known):
        return ''
    name = section.rpartition('/')[2]
    alike = get_close_matches(name, names, 1, ALIKE)
    if driven and not alike and is_of(section, f'{namespace}/{name}'):
        return f'{path}: section {section} is of no node here; a driver of that name may read it'
    alike = [name] if name in known else alike or get_close_matches(name, known, 1)
    hint = f'write /**/{alike[0]}. ' if alike else ''
    raise ValueError(f'{path}: section {section} matches no node in {namespace}: {hint}The nodes '
                     f'are {", ".join(names)}')


def _check_site(nodes, path):
    """Of the observer, which on a real mount must have one, and of the guard."""
    from .guard.allowed_sky import PLACE, differ
    sites = {}
    for name in {GUARD, OBSERVER} & nodes.keys():
        spec, values = nodes[name]
        if spec.parameters.get('use_sim_time'):
            values = simulated_site() | values
        sites[name] = [values.get(one) for one in PLACE]
    lacking = [name for name in sorted(sites) if None in sites[name]]
    if OBSERVER in lacking:
        raise ValueError(
            f'no site for {" and ".join(lacking)}: set latitude_deg and longitude_deg '
            '(parameter file, under /**:, or --latitude and --longitude)')
    # without one the guard says itself whether it needs it; nodes refuse what is no number
    if not lacking and len(sites) == 2 and all(
            isinstance(value, int | float) for site in sites.values() for value in site) and (
            differ(*sites.values())):
        texts = [f'{name} ({", ".join(f"{value:.4f}" for value in sites[name])} deg)'
                 for name in sorted(sites)]
        raise ValueError(f'the nodes {" and ".join(texts)} have different sites: give all one'
                         + (f', under /**: in {path}' if path else ''))
