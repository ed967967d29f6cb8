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

"""The command ``verify``."""

from . import options


def add(commands):
    """Add the parser."""
    parser = commands.add_parser(
        'verify', help='recompute the results in a log, and compare',
        description='Compute observations, zeros, models, reports and diagnoses of a log again '
        'from what they were derived from, without a ROS graph. Exit code 1 if a number differs by '
        'more than rounding, or the log is damaged.')
    parser.add_argument('log', type=options.log_path, metavar='BAG')
    options.add(parser, 'reference',
                help='the reference model of the night (default: as the log says)')
    options.add(parser, 'seed', default=None,
                help='of the choice of held-out stars (default: as the log says, or 1)')
    options.add_json(parser, 'what was checked')


def run(args):
    """Compute, compare, print; 1 if something differs."""
    from ..log_check.log_check import verify_log
    from .console import ProgressLine, new_console, print_lines, write_outputs
    with ProgressLine(unit='rows', first='reading the log') as progress:
        report = verify_log(args.log, reference=args.reference, seed=args.seed, progress=progress)
    console = new_console()
    print_lines(console, 'note', report['unchecked'])
    print_lines(console, 'difference', report['differences'])
    total = sum(report['checked'].values())
    console.print(', '.join(f'{count} {kind}' for kind, count in report['checked'].items()))
    rounded = report['rounded']
    console.print(f'{total - len(report["differences"]) - rounded} of {total} are identical bit '
                  'by bit' + f', {rounded} within rounding (another processor or numpy)'
                  * bool(rounded))
    write_outputs(console, args, report)
    return 1 if report['differences'] or report['damaged'] else 0
