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

"""Writes the pages of nodes and topics and the pictures of the graph, from the nodes' declarations.

    .venv/bin/python docs/make/nodes.py

Starts each node in its own ROS context, once for each variant of its topics, and queries its
parameters, topics and services. Descriptions of topics and services are in `TOPICS` and `SERVICES`
here. A test checks that the pages in the repository are up to date.
"""

import json
import os
import re
import sys
import tempfile
from importlib import import_module
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / 'docs'
HEAD = '<!-- made by docs/make/nodes.py from what the nodes declare; do not edit -->\n'

#: contents of each topic, and their unit
TOPICS = {
    '/clock': 'the time of a simulated or replayed night',
    'request/owner': 'node that asks, and the stamp of its request, ns',
    'request': 'where a commander wants the axes to be, encoder angles, rad',
    'guard/status': 'what the guard does and why; the sky that it allows',
    'command': 'where the axes must be in the next seconds, encoder angles, rad',
    'truth/joint_states': 'true angles of the axes, rad; for simulated hardware alone',
    'truth/incremental_zero': 'true zero of the incremental encoder, rad',
    'truth/scenario': 'what is wrong with the simulated mount, JSON',
    'incremental/joint_states': "readings of the axes' encoders, rad and rad/s; NaN: not homed",
    'incremental/power_on': 'number and start of its power-on, once in each',
    'incremental/homing': 'how each reference mark was met, one row an axis',
    'absolute/joint_states': 'readings of the absolute encoders, rad; NaN: no reading',
    'absolute/power_on': 'number and start of its power-on, once in each',
    'absolute/pose': 'these readings with their covariance as the image gives it, in `axes`',
    'absolute/frame': "image of the discs' bars, one row an axis",
    'camera/miss_distance': 'star − boresight: x right, y down, rad; NaN: no star',
    'ambient/temperature': 'air temperature, °C; the simulator gives it in scenarios with '
                           '`weather` alone, else a driver of yours may',
    'inclinometer': 'what the base leans to the north (x) and west (y), rad',
    'observation': 'one star: catalogue place, readings, miss distance, air',
    'observations': 'rows so far of the last power-ons (`kept_power_ons`)',
    'offset': 'encoder − catalogue of the last star, on the sky, rad',
    'observer/status': 'the step of the plan, and what holds it up',
    'observer/plan/status': "state of the plan, as of an action's goal",
    'observer/plan/feedback': 'how far it is, numbers; the last are its result',
    'observer/checks': 'results of the steps `check` and `clocks`, JSON',
    'zero': "the encoders' zero with its standard error (`effort`), rad",
    'zero/pose': 'the same angles with their covariance, in `axes`',
    'zero/identity': 'the power-on and the model that the zero is of',
    'zero/expected_change': 'by how much the zero will have changed, with σ, before a star tells',
    'model': 'the pointing model, JSON',
    'diagnosis': 'what the model lacks, JSON',
    'calibration/report': 'zeros, fits and checks of the night, JSON',
    'calibration/status': 'what the calibration knows and does',
    'calibration/figures': 'terms, zero, RMS, expected error as numbers, arcsec',
    'calibration/residual': 'encoder − model of each star, at its time, rad',
    'calibration/residuals': 'the same of all, with their places',
    'calibration/table': 'the rows of the night, for an observer that was started anew',
    'tracking': 'what the last star said to a model that follows the mount, JSON',
    'apart': 'how causes that a diagnosis leaves open stand, and the star that tells most, JSON',
    'target': 'a wanted direction over time, observed place, rad',
    'demand': 'the same as encoder angles and rates, rad and rad/s',
    'demand_sigma': 'how far it is expected to be off, on the sky, rad; NaN: not known',
    'in_force': 'zero and model that are applied, as one JSON text',
    '/diagnostics': 'health of each node, once a second: at most 15 values',
    '/endpoints': 'of each node: endpoints matched, messages counted, for programs',
    'robot_description': 'the mount as URDF, for RViz and Foxglove',
    'joint_states': 'the joints of that model, rad',
    'markers': 'where the mount looks and where it is sent, for RViz and Foxglove',
}
SERVICES = {
    'power_cycle': 'switches the incremental encoder off and on: its zero is lost',
    'absolute/power_cycle': 'switches the absolute encoder off and on',
    'home': 'meets the reference marks, or says at once that none is needed',
    'observe': 'begins the plan, or goes on where it stopped',
    '~/plan': 'begins a plan of typed steps, such as stars: 20',
    '~/anew': 'begins the plan from its first step',
    '~/cancel': 'ends what it is doing',
    'zero': 'sets the zero on Polaris, or on a few stars where that is not well up',
    'zero_on_polaris': 'sets the zero on Polaris',
    'zero_on_stars': 'sets the zero on a few stars',
    'abort': 'stops the mount and cancels the plan; no request is taken until `resume`',
    'pause': 'stops the mount; the plan waits',
    'resume': 'goes on after `pause`, `abort` or `park`',
    'park': 'cancels the plan, leads the mount to `park_deg`, and locks it until `resume`',
    'calibrate_zero': 'sets the zero from the exposures so far',
    'fit': 'fits a model to the rows so far and publishes it',
    'judge': 'judges the last change of the model on fresh stars',
    'diagnose': 'looks for what the model lacks, and publishes what holds',
    '~/pause': 'pauses', '~/resume': 'goes on', '~/split_bagfile': 'begins a new file',
    '~/snapshot': 'writes what is kept in memory',
    '~/play_next': 'publishes one message', '~/burst': 'publishes `burst_count` messages',
    '~/seek': 'goes to `seek_s`', '~/toggle_paused': 'pauses or goes on',
    '~/is_paused': 'says whether it is paused', '~/stop': 'ends',
    '~/get_rate': 'says how fast it plays',
}
#: parameters for variants with other topics; the first one is used for the table of parameters
WAYS = {
    'absolute_encoder': ({}, {'publishes': 'frames'}),
    'star_observer': ({'autostart': False, 'absolute_encoder': True, 'inclinometer': True},),
    'mcap_replay': ({'bag': str(ROOT / 'test' / 'data' / 'sample_log'), 'start_paused': True},),
    'run_player': ({'file': str(ROOT / 'calibration' / 'data' / 'mmt_2021-08-21.csv')},),
    'mount_guard': ({'autostart': False, 'latitude_deg': 34.3, 'longitude_deg': 109.0},),
    **{name: ({'autostart': False},) for name in (
        'indi_mount', 'indi_sky', 'alpaca_mount', 'alpaca_sky')},
}
_OWN = re.compile(r'/(?:describe|get|list|set)_[a-z_]*parameter|get_type_description|'
                  r'(?:change|get)_(?:available_)?(?:state|transition)')
_UNIT = re.compile(r'\s+\[([^\]]+)\]')
#: endings of parameter names and their units
_UNITS = (('_deg_s2', 'deg/s²'), ('_deg_s', 'deg/s'), ('_arcsec_s', 'arcsec/s'), ('_deg', 'deg'),
          ('_arcsec', 'arcsec'), ('_hz', 'Hz'), ('_ms', 'ms'), ('_hpa', 'hPa'),
          ('_um', 'µm'), ('_mb', 'MB'), ('_c', '°C'), ('_m', 'm'), ('_s', 's'))


def declared(folder):
    """Declarations of each node of the graph.

    Parameters
    ----------
    folder : str or Path
        An empty folder, for the log of the logger.

    Returns
    -------
    dict of str to dict
        Node -> ``module``, ``doc``, ``managed``, ``params`` (list of Param), ``publishes`` and
        ``subscribes`` (topic -> Topic), ``services`` and ``asks`` (name -> type).
    """
    import rclpy

    from msg_tools.node_lifecycle import ManagedNode
    from msg_tools.node_process import node_of
    from telescope_mount.graph import NODES
    context = rclpy.context.Context()
    rclpy.init(context=context, domain_id=int(os.environ.get('ROS_DOMAIN_ID', 77)))
    found = {}
    try:
        for name, module in NODES.items():
            ways = WAYS.get(name, ({},))
            if name == 'mcap_logger':
                ways = ({'folder': str(Path(folder) / 'bag'), 'provenance': False},)
            entry = found[name] = {
                'module': module, 'doc': import_module(module).__doc__, 'publishes': {},
                'subscribes': {}, 'services': {}, 'asks': {}}
            for way in ways:
                node = node_of(module)(context=context, overrides=way)
                try:
                    _ask(node, entry)
                    entry['managed'] = isinstance(node, ManagedNode)
                finally:
                    node.finish()
                    node.destroy_node()
    finally:
        rclpy.shutdown(context=context)
    return found


def _ask(node, entry):
    """Add the declarations of one node."""
    from msg_tools import topics
    known = {node.resolve_topic_name(value.name): value for value in vars(topics).values()
             if isinstance(value, topics.Topic)}
    entry.setdefault('params', list(node._params.values()))
    for kind, endpoints in (('publishes', node._publishers_of), ('subscribes',
                                                                  node._subscriptions_of)):
        entry[kind].update({known[name].name: known[name] for name in endpoints if name in known})
    prefix, own = f'{node.get_namespace()}/', f'{node.get_fully_qualified_name()}/'

    def short(name):
        return name.replace(own, '~/').removeprefix(prefix)
    entry['services'].update({short(each.srv_name): _type_of(each) for each in node.services
                              if not _OWN.search(each.srv_name)})
    entry['asks'].update({short(each.srv_name): _type_of(each) for each in node.clients
                          if not _OWN.search(each.srv_name)})


def _type_of(endpoint):
    kind = endpoint.srv_type
    return f'{kind.__module__.split(".")[0]}/{kind.__name__}'


# --- pages ----------------------------------------------------------------------------------------


def pages(found):
    """Text of each page, and of the list for ``--help``, by its path from docs, dict of str."""
    from telescope_mount.graph import MEASURED, NIGHT, REAL
    out = {f'nodes/{name}.md': node_page(name, entry) for name, entry in found.items()}
    out['nodes/index.md'] = index_page(found)
    out['topics.md'] = topics_page(found)
    out['../msg_tools/endpoints.json'] = json.dumps(
        {name: {'takes': sorted(entry['subscribes']), 'gives': sorted(entry['publishes']),
                'services': sorted(entry['services'])} for name, entry in found.items()},
        indent=1) + '\n'
    out['pictures/graph_night.svg'] = picture(found, NIGHT, 'The graph of a simulated night')
    out['pictures/graph_real.svg'] = picture(found, REAL, 'The graph of a real mount', drivers=True)
    out['pictures/graph_measured.svg'] = picture(
        found, MEASURED, 'The graph of a measured run', every=True)
    return out


def node_page(name, entry):
    """The page of a node."""
    first, _, more = entry['doc'].strip().partition('\n')
    package = entry['module'].split('.')[0]
    lines = [HEAD, f'# {name}', '', _said(first), '']
    if more.strip():
        lines += [' '.join(more.split()), '']
    lines += [f'Package `{package}`, module [`{entry["module"]}`](../../'
              f'{entry["module"].replace(".", "/")}.py).'
              + (' A managed (lifecycle) node: [what its states mean](../ros.md).'
                 if entry['managed'] else ''), '', '## Topics', '']
    for kind, title in (('subscribes', 'Takes'), ('publishes', 'Gives')):
        if entry[kind]:
            lines += [f'{title}: ' + ', '.join(f'`{topic}`' for topic in sorted(entry[kind])) + '.',
                      '']
    if name == 'mcap_logger':
        lines += ['Takes every topic of the graph that it is told to record.', '']
    if name == 'mcap_replay':
        lines += ['Gives the topics that the log has.', '']
    for kind, title in (('services', 'Services'), ('asks', 'Services that it asks for')):
        if entry[kind]:
            lines += [f'## {title}', '']
            lines += [f'- `{service}`{_unlike(entry[kind][service])}: {SERVICES[service]}'
                      for service in sorted(entry[kind])] + ['']
    lines += ['## Parameters', '']
    if entry['params']:
        lines += ['| parameter | default, unit, range | what it does |', '| --- | --- | --- |']
        lines += [_parameter(param) for param in entry['params']]
    else:
        lines += ['None.']
    return '\n'.join(lines) + '\n'


def _said(sentence):
    return sentence[:1].upper() + sentence[1:]


def _unlike(kind):
    """The type of a service, if it is not the usual one."""
    return '' if kind == 'std_srvs/Trigger' else f' ({kind})'


def _kind(topic):
    return topic.type.replace('/msg/', '/')


def _parameter(param):
    text, unit = param.doc, ''
    told = _UNIT.findall(text)
    if told:
        unit, text = told[-1], _UNIT.sub('', text)
    else:
        unit = next((unit for end, unit in _UNITS if param.name.endswith(end)), '')
    default = param.default
    if isinstance(default, list | tuple):
        shown = ', '.join(f'`{each}`' for each in default if each != '') or 'empty'
    else:
        shown = 'empty' if default == '' else f'`{str(default).lower()}`' if isinstance(
            default, bool) else f'`{default}`'
    limits = ', '.join(f'`{choice}`' if choice else 'empty' for choice in param.choices)
    if param.low is not None:
        limits = f'{_number(param.low)} to {_number(param.high)}'
    said = f'{shown} {unit}'.strip() + (f', {limits}' if limits else '')
    flags = ', '.join(f'*{word}*' for word, there in (('start', param.fixed),
                                                      ('truth', param.truth)) if there)
    cells = (f'`{param.name}`', said, f'{text}. {flags}' if flags else text)
    return '| ' + ' | '.join(cell.replace('|', '\\|') for cell in cells) + ' |'


def _number(value):
    return f'{value:g}' if isinstance(value, float) else str(value)


def index_page(found):
    """The list of all nodes."""
    lines = [HEAD, '# Nodes', '', 'Names are relative to the namespace `/mount`; types of topics '
             'are in [topics.md](../topics.md), pictures in [graph.md](../graph.md).', '',
             '- Every node reports on `/diagnostics` once a second, and has `use_sim_time` '
             '(`false`): time is that of `/clock`. All nodes of a graph must have the same.',
             '- Services are std_srvs/Trigger unless said.',
             '- *start*: set only when the node starts. *truth*: what only the simulator knows; '
             'the calibration never sees it.',
             '- A managed node also has the services and `~/transition_event` of '
             '[lifecycle nodes](../ros.md#managed-nodes).', '',
             '| node | package | what it is |', '| --- | --- | --- |']
    lines += [f'| [{name}]({name}.md) | {entry["module"].split(".")[0]} | '
              f'{_said(entry["doc"].strip().splitlines()[0])} |' for name, entry in found.items()]
    return '\n'.join(lines) + '\n'


def topics_page(found):
    """The list of all topics."""
    from msg_tools import topics
    lines = [HEAD, '# Topics', '', 'Types and qualities of service stand in one file, '
             '[`msg_tools/topics.py`](../msg_tools/topics.py). Names are relative to the namespace '
             '`/mount`. Only standard messages are used. *Latched*: who comes late still gets the '
             'last message. A driver of your own may take the place of any node: '
             '[real_mount.md](real_mount.md).', '',
             '| topic | carries | type | quality of service | from | to |',
             '| --- | --- | --- | --- | --- | --- |']
    every = [value for value in vars(topics).values() if isinstance(value, topics.Topic)]
    for topic in sorted(every, key=lambda each: each.name.lstrip('/')):
        quality = topic.qos.reliability.name.lower().replace('_', ' ') + (
            f', {topic.qos.depth} deep') + (', latched' if topic.latched else '')
        ends = [', '.join(f'[{name}](nodes/{name}.md)' for name in found
                          if topic.name in found[name][kind]) for kind in ('publishes',
                                                                           'subscribes')]
        if topic.name == '/diagnostics':
            ends = ['every node', '[mcap_logger](nodes/mcap_logger.md)']
        if topic.name == '/endpoints':
            ends = ['every node', ', '.join(f'[{name}](nodes/{name}.md)' for name in (
                'mcap_logger', 'star_observer', 'mcap_replay', 'run_player'))
                + ' (the last three until the others are connected)']
        lines.append(f'| `{topic.name}` | {TOPICS[topic.name]} | {_kind(topic)} | {quality} | '
                     f'{ends[0] or "a driver, or a program of yours"} | {ends[1]} |')
    return '\n'.join(lines) + '\n'


# --- pictures -------------------------------------------------------------------------------------

_STYLE = ('<style>text{font:13px system-ui,sans-serif;fill:#1b2430}.t{font-family:ui-monospace,'
          'monospace;font-size:12px}.s{fill:#667}line{stroke:#9aa5b1}.col{stroke-dasharray:2 4}'
          '.wire{stroke:#31567a;stroke-width:1.5}.pub{fill:#c2410c}.sub{fill:#fff;stroke:#31567a;'
          'stroke-width:2}.box{fill:#eef3f8;stroke:#31567a}rect.bg{fill:#fff}</style>')
_ROW, _COLUMN, _LEFT, _TOP = 24, 92, 205, 74


def picture(found, names, title, drivers=False, every=False):
    """Nodes as columns, topics as rows: filled marks publish the topic, open ones subscribe.

    Parameters
    ----------
    found : dict
        See `declared`.
    names : sequence of str
        Nodes of the graph.
    drivers : bool
        Add a column for the drivers of a real mount, instead of the simulated hardware.
    every : bool
        Also show topics that only one node of the graph has.
    """
    from telescope_mount.graph import SIMULATED
    nodes = {name: found[name] for name in names}
    if drivers:
        gives = {topic for name in SIMULATED for topic in found[name]['publishes']
                 if not topic.startswith(('truth', '/clock'))} | {'inclinometer'}
        nodes = {'your drivers': {'publishes': gives, 'subscribes': {'command'}}, **nodes}
    columns = [name for name in nodes if name != 'mcap_logger']
    rows = [topic for topic in TOPICS if topic not in ('/diagnostics', '/endpoints') and (
        any(topic in nodes[name]['publishes'] for name in columns))
        and (every or any(topic in nodes[name]['subscribes'] for name in columns)
             or topic in ('offset', 'demand', 'demand_sigma', 'calibration/report', 'diagnosis'))]
    # in the order of the publishers, so that data flow from left to right
    rows.sort(key=lambda topic: next(i for i, name in enumerate(columns)
                                     if topic in nodes[name]['publishes']))
    width = _LEFT + _COLUMN * len(columns) + 10
    bottom = _TOP + _ROW * len(rows)
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {bottom + 44}" '
           f'width="{width}" height="{bottom + 44}" role="img"><title>{title}</title>', _STYLE,
           f'<rect class="bg" width="{width}" height="{bottom + 44}"/>']
    for i, name in enumerate(columns):
        x = _LEFT + _COLUMN * i + _COLUMN // 2
        out.append(f'<line class="col" x1="{x}" y1="{_TOP - 14}" x2="{x}" y2="{bottom}"/>')
        out.append(f'<rect class="box" x="{x - 43}" y="14" width="86" height="42" rx="6"/>')
        words = name.replace('_', ' ').split(' ')
        for k, word in enumerate(words):
            y = 40 + 16 * (k - (len(words) - 1) / 2)
            out.append(f'<text x="{x}" y="{y:g}" text-anchor="middle">{word}</text>')
    for k, topic in enumerate(rows):
        y = _TOP + _ROW * k + 8
        gives = [i for i, name in enumerate(columns) if topic in nodes[name]['publishes']]
        takes = [i for i, name in enumerate(columns) if topic in nodes[name]['subscribes']]
        ends = [_LEFT + _COLUMN * i + _COLUMN // 2 for i in {*gives, *takes}]
        out.append(f'<text class="t" x="{_LEFT - 8}" y="{y + 4}" text-anchor="end">{topic}</text>')
        out.append(f'<line x1="{_LEFT}" y1="{y}" x2="{width - 10}" y2="{y}" opacity=".35"/>')
        out.append(f'<line class="wire" x1="{min(ends)}" y1="{y}" x2="{max(ends)}" y2="{y}"/>')
        out += [f'<circle class="sub" cx="{_LEFT + _COLUMN * i + _COLUMN // 2}" cy="{y}" r="5"/>'
                for i in takes]
        out += [f'<rect class="pub" x="{_LEFT + _COLUMN * i + _COLUMN // 2 - 5}" y="{y - 5}" '
                'width="10" height="10"/>' for i in gives]
    y = bottom + 24
    out.append(f'<rect class="pub" x="12" y="{y - 10}" width="10" height="10"/>'
               f'<text class="s" x="28" y="{y}">gives the topic</text>'
               f'<circle class="sub" cx="145" cy="{y - 5}" r="5"/>'
               f'<text class="s" x="156" y="{y}">takes it</text>'
               f'<text class="s" x="232" y="{y}">mcap_logger takes everything</text></svg>')
    return '\n'.join(out) + '\n'


def main():
    """Write all pages and pictures."""
    sys.path.insert(0, str(ROOT))
    from telescope_mount.dds import dds_environment
    os.environ.update(dds_environment())
    with tempfile.TemporaryDirectory() as folder:
        made = pages(declared(folder))
    for old in {*(DOCS / 'nodes').glob('*.md')} - {DOCS / path for path in made}:
        old.unlink()
    for path, text in made.items():
        (DOCS / path).parent.mkdir(parents=True, exist_ok=True)
        (DOCS / path).write_text(text, encoding='utf-8')
    print(f'{len(made)} files in {DOCS}')


if __name__ == '__main__':
    main()
