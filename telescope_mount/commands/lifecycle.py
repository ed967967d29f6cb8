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

"""The command ``lifecycle``: like `ros2 lifecycle`, without `ros2`."""

from contextlib import closing

from . import options

#: see `telescope_mount.missing_ros`
NEEDS_ROS = True

#: in the order of the states
TRANSITIONS = ('configure', 'activate', 'deactivate', 'cleanup', 'shutdown')


def add(commands):
    """Add the parser."""
    parser = commands.add_parser(
        'lifecycle', help='states of the nodes that can move a mount; change one',
        description='List the managed nodes of a running graph and their states, or have one '
        'make a transition. What is not active moves nothing. Exit code 0, or 1 where the '
        'transition was not made.')
    parser.add_argument('node', nargs='?', help='name, such as mount_guard')
    parser.add_argument('transition', nargs='?', choices=TRANSITIONS)
    options.add_graph(parser)
    options.add_json(parser, 'the states')


def run(args):
    """List, or change."""
    from ..processes import domain
    from ..running_graph.graph_client import GraphClient
    from .console import new_console, print_all, write_json
    if args.node and not args.transition:
        raise ValueError(f'{args.node}: name a transition, {", ".join(TRANSITIONS)}')
    with closing(GraphClient(domain.join(args.domain).number, args.namespace,
                             'lifecycle')) as nodes:
        done = not args.node or nodes.change(args.node, args.transition)
        states = {name: nodes.state(name) for name in (
            [args.node] if args.node else nodes.managed())}
    more = '' if done else f'; transition {args.transition} failed'
    print_all(new_console(), (f'{name}: {state}{more}' for name, state in states.items()))
    if args.json:
        write_json(args.json, states)
    return int(not done)
