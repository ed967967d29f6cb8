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

"""The command ``guard``: state of the guard, and stopping the mount, without `ros2`."""

from contextlib import closing

from . import options

#: see `telescope_mount.missing_ros`
NEEDS_ROS = True

#: services of the guard
VERBS = ('abort', 'pause', 'resume', 'park')


def add(commands):
    """Add the parser."""
    parser = commands.add_parser(
        'guard', help='stop, park or release the mount of a running graph; the state of its guard',
        description='Ask the guard of a running graph (docs/guard.md). abort and pause stop the '
        'mount, park sends it to its park position, resume lets it go on. Without a verb: its '
        'state. Exit code 0, or 1 where it refuses.')
    parser.add_argument('verb', nargs='?', choices=VERBS)
    options.add_graph(parser)
    options.add_json(parser, 'the answer')


def run(args):
    """Ask, print."""
    from msg_tools import topics

    from ..processes import domain
    from ..running_graph.graph_client import GraphClient
    with closing(GraphClient(domain.join(args.domain).number, args.namespace,
                             'guard_client')) as graph:
        if args.verb:
            done, text = graph.trigger(args.verb)
            _answer(args, {'done': done, 'said': text},
                    text if done else f'{args.verb} refused: {text}')
            return int(not done)
        status = graph.last(topics.GUARD_STATUS)
        if status is None:
            raise ValueError(f'no guard in {args.namespace}{graph.where_else()}')
        _answer(args, {row.key: row.value for row in status.values} | {'said': status.message},
                sentence(status))


def _answer(args, document, text):
    from .console import new_console, write_json
    new_console().print(text)
    if args.json:
        write_json(args.json, document)


def sentence(status):
    """Content of a message on `guard/status`, in one or two lines."""
    rows = {row.key: row.value for row in status.values}
    lines = [f'{rows["state"]}: {status.message}']
    if rows.get('reason'):
        lines.append(f'last refused: {rows["reason"]}')
    return '\n'.join(lines)
