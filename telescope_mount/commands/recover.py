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

"""The command ``recover``: a new log with everything that can be read from a damaged one."""

from pathlib import Path

from . import options


def add(commands):
    """Add the parser."""
    parser = commands.add_parser(
        'recover', help='make a whole log of what can be read of a damaged one',
        description='Write what can be read of a log into a new one, with index, statistics and '
        'metadata. Print how many messages of which topics and times are lost. The damaged log '
        'is only read. Exit code 1 where anything of it is missing in the new one.')
    parser.add_argument('log', type=options.log_path, metavar='BAG')
    parser.add_argument('--out', type=Path, metavar='DIR',
                        help='folder of the new log (default: BAG_recovered)')
    options.add_json(parser, 'what was saved and lost')


def run(args):
    """Recover and print."""
    from msg_tools.bag.log_copy import recover_log

    from .console import new_console, print_lines, write_outputs
    report = recover_log(args.log, args.out)
    console = new_console()
    print_lines(console, 'problem', report['lost'])
    print_lines(console, 'lost', [
        f'{topic}: {n} of {report["recorded"][topic]} messages'
        for topic, n in report['missing'].items()])
    console.print(f'{report["messages"]} messages of {report["topics"]} topics saved: '
                  f'{report["out"]}; {_what_is_lost(report)}', soft_wrap=True)
    write_outputs(console, args, report)
    return int(not report['whole'])


def _what_is_lost(report):
    from msg_tools.bag.losses import span
    if report['whole']:
        return 'nothing is lost'
    total = report['messages'] + report['messages_lost']
    count = f'{report["messages_lost"]} of {total} messages are lost'
    if not report['all_known']:
        count = f'at least {count}' if report['messages_lost'] else 'how many are lost is not known'
    parts = [part for part in report['parts'] if part['start_ns'] is not None]
    when = f', {span(parts[0]["start_ns"], parts[0]["end_ns"])}' if len(parts) == 1 else ''
    damaged = f' ({report["lost_bytes"]} bytes)' if report['lost_bytes'] else ''
    return f'{count}{damaged}{when}'
