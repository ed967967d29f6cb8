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

"""The user's ROS parameter file: which nodes it is for, and which site it gives them.

If several sections match, the last one wins, in the order in which names first appear in all files.
"""

from difflib import get_close_matches

from msg_tools import NAMESPACE
from msg_tools.parameter_sections import ALIKE, is_of, sections
from pointing_model.sky.refraction import odd_pressure
from pointing_model.sky.site import DEFAULT_SITE

from ..graph import NODES, WITH_BUILT_TYPES, simulated_site

#: nodes that move a mount; a graph without one has drivers, whose names are unknown
MOUNTS = ('mount_simulator', 'indi_mount', 'alpaca_mount')
GUARD, OBSERVER = 'mount_guard', 'star_observer'


def values_of(node, parameters, found):
    """Parameters of a node at its start.

    Parameters
    ----------
    node : str
        Its full name.
    parameters : dict
        Parameters from the graph.
    found : dict
        See `sections`.

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
    """Refuse a file that leaves a node without its parameters, or gives nodes different sites.

    Parameters
    ----------
    specs : list of graph.NodeSpec
        The nodes that will be started.
    path : str or Path, optional
        The parameter file; without it only the graph's own values are checked.
    drivers : sequence
        Drivers that will be started, too.
    namespace : str
        Their namespace.

    Returns
    -------
    list of str
        Notes on sections that only a driver can read, and on the air of a real mount.

    Raises
    ------
    ValueError
        A section matches no node, or the nodes have no site or different ones.
    """
    found, namespace = sections(path) if path else {}, f'/{namespace.strip("/")}'.rstrip('/')
    names = [spec.name for spec in specs]
    driven = bool(drivers) or not any(name in MOUNTS for name in names)
    notes = [_note(path, section, names, driven, namespace) for section in found]
    nodes = {spec.name: (spec, values_of(f'{namespace}/{spec.name}', spec.parameters, found))
             for spec in specs}
    _check_site(nodes, path)
    if OBSERVER in nodes and 'mount_simulator' not in nodes:
        notes += _notes_on_air(nodes[OBSERVER][1])
    return list(filter(None, notes))


def _note(path, section, names, driven, namespace):
    """'' for a section of a known node; ValueError for one that no node can read."""
    known = list(dict.fromkeys([*names, *NODES, *WITH_BUILT_TYPES]))
    if any(is_of(section, f'{namespace}/{name}') for name in known):
        return ''
    name = section.rpartition('/')[2]
    alike = get_close_matches(name, names, 1, ALIKE)
    if driven and not alike and is_of(section, f'{namespace}/{name}'):
        return f'{path}: section {section} matches no node here; a driver of that name may read it'
    alike = [name] if name in known else alike or get_close_matches(name, known, 1)
    hint = f'write /**/{alike[0]}. ' if alike else ''
    raise ValueError(f'{path}: section {section} matches no node in {namespace}: {hint}The nodes '
                     f'are {", ".join(names)}')


def _notes_on_air(values):
    """Notes on the pressure that the observer's refraction rests on, from its parameters."""
    height, pressure = values.get('height_m'), values.get('pressure_hpa', -1.0)
    if not all(isinstance(value, int | float | None) for value in (height, pressure)):
        return []  # the node refuses it
    if height is None:
        return [] if pressure >= 0.0 else [
            f'no height of the site: refraction is computed for {DEFAULT_SITE.height:g} m. Set '
            'height_m or pressure_hpa (parameter file, under /**:, or --height)']
    return [] if pressure < 0.0 else odd_pressure(pressure, height)


def _check_site(nodes, path):
    """Check the sites of the observer, which needs one on a real mount, and of the guard."""
    from ..guard.allowed_sky import PLACE, differ
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
    # the guard itself reports a missing site if it needs one; nodes refuse non-numeric values
    if not lacking and len(sites) == 2 and all(
            isinstance(value, int | float) for site in sites.values() for value in site) and (
            differ(*sites.values())):
        texts = [f'{name} ({", ".join(f"{value:.4f}" for value in sites[name])} deg)'
                 for name in sorted(sites)]
        raise ValueError(f'the nodes {" and ".join(texts)} have different sites: set one for all'
                         + (f', under /**: in {path}' if path else ''))
