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

"""The command ``watch``: a dashboard of a running graph, or of a log."""

import sys
import time
from contextlib import closing, suppress

from msg_tools import NAMESPACE

from . import options

#: most s to find a graph, and then until its nodes have reported everything
FOUND, COMPLETE = 10.0, 2.0
#: s between two updates, of which the second number is for receiving messages
PICTURE, TAKING = 0.25, 0.05


def add(commands):
    """Add the parser."""
    parser = commands.add_parser(
        'watch', help='a dashboard of a running graph or of a log: sky, offsets, zero, alarms',
        description='Show the state of a running graph in the terminal until Ctrl-C, or that of a '
        'log at its end (docs/watch.md). Without a terminal, or with --json: once. '
        'It only listens. A log needs no ROS.')
    parser.add_argument('log', nargs='?', type=options.log_path, metavar='BAG',
                        help='a log; without one the running graph')
    parser.add_argument('--at', metavar='TIME', help='of a log: the state then, UTC as '
                        '2026-01-15T13:00:00 or seconds since its begin (default: its end)')
    parser.add_argument('--once', action='store_true', help='print the state once and end')
    options.add_graph(parser)
    options.add_json(parser, 'the state')


def run(args):
    """Listen or read, draw."""
    if args.log is None and args.at is not None:
        raise ValueError('--at needs a log: name one')
    if args.log is not None and args.domain is not None:
        raise ValueError('--domain applies to a running graph, not to a log; leave one out')
    args.namespace = '/' + args.namespace.strip('/')
    if args.log is None:
        _graph(args)
    else:
        _print_state(args, _log(args).state())


def _log(args):
    from msg_tools.bag.sqlite import open_bag
    from msg_tools.bag.topic_names import prefixes_of

    from ..dashboard.log_state import log_messages
    from .export import time_of
    bag = open_bag(args.log)
    if args.namespace == NAMESPACE and len(found := prefixes_of(bag)) == 1:
        args.namespace = found[0].rstrip('/')  # a log is mostly of one graph
    if args.at is None or bag.start_time is None:
        return log_messages(bag, args.namespace)
    end = time_of(args.at, bag.start_time)
    if not bag.start_time <= end:
        raise ValueError(f'--at {args.at} is before the log begins')
    return log_messages(bag, args.namespace, end)


def _print_state(args, state):
    """Print the state once."""
    from ..dashboard.terminal_view import Dashboard
    from .console import new_console, write_json
    new_console().print(Dashboard(state))
    if args.json:
        write_json(args.json, state.document())


def _graph(args):
    from .. import missing_ros as ros
    from ..processes import domain
    ros.check('watch')
    from ..running_graph.graph_client import GraphClient
    number = domain.join(args.domain).number
    with closing(GraphClient(number, args.namespace, 'watch')) as graph:
        messages = listen(graph, f'graph in {args.namespace}, domain {number}', args.namespace)
        if args.once or args.json or not sys.stdout.isatty():
            if not graph.spin_until(lambda: messages.any, FOUND):
                raise ValueError(f'no messages in {args.namespace}{graph.where_else()}')
            graph.spin_for(COMPLETE)
            _print_state(args, messages.state(time.monotonic()))
        else:
            _dashboard(graph, messages)


def listen(graph, source, namespace):
    """Last messages of a graph, from now on.

    Parameters
    ----------
    graph : GraphClient
    source : str
        Name of the graph.
    namespace : str

    Returns
    -------
    LastMessages
    """
    from msg_tools import topics

    from ..dashboard.graph_state import SUBSCRIBED, LastMessages
    messages = LastMessages(source, namespace)
    # of a thousand readings a second only the latest is needed; the clock is as fast
    latest = topics.make_qos(1, reliable=False)
    for topic in SUBSCRIBED:
        fast = topic in (topics.INCREMENTAL, topics.ABSOLUTE, topics.CLOCK, topics.REQUEST)
        graph.node.create_subscription(
            topic.message, topic.name,
            lambda message, name=topic.name: messages.take(name, message, arrived=time.monotonic()),
            latest if fast else topic.qos)
    return messages


def _dashboard(graph, messages):
    """Draw until Ctrl-C, SIGTERM or SIGHUP."""
    from rich.live import Live

    from ..dashboard.terminal_view import Dashboard
    from .console import new_console, step_aside
    step_aside(for_good=True)
    begin, lost = time.monotonic(), ''
    with suppress(KeyboardInterrupt), Live(
            console=new_console(), screen=True, auto_refresh=False,
            vertical_overflow='crop') as live:
        while True:
            graph.spin_for(TAKING)
            if not messages.any and not lost and time.monotonic() - begin > FOUND:
                lost = f'; no messages yet{graph.where_else()}'
            note = 'Ctrl-C ends' + ('' if messages.any else lost)
            live.update(Dashboard(messages.state(time.monotonic()), note, whole=False),
                        refresh=True)
            time.sleep(PICTURE - TAKING)
