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

"""The command ``experiment``."""

from ..commands import options

#: see `telescope_mount.missing_ros`
NEEDS_ROS = True


def add(commands):
    """Add the parser."""
    parser = commands.add_parser(
        'experiment', help='the eleven nights and the GPS satellite of paper 000',
        description='Observe thirteen nights through the node graph: a power-on each, 30 stars, '
        'Polaris, 30 stars. The model of two nights before corrects tonight, before and after the '
        "zero calibration. On one night a GPS satellite is tracked. Prints the paper's table 1 "
        'with ours beside it, and what the zeros follow: temperature, supply, time, side of the '
        'mark.')
    options.add_out(parser, 'experiment', 'tables, log and page')
    options.add(parser, 'seed')
    parser.add_argument('--nights', type=options.whole(4, 200), default=11,
                        help='of the table, after two for their models (default: 11)')
    what = parser.add_mutually_exclusive_group()
    options.add_scenario(
        what, help='errors of the simulated mount, instead of the drifts: a '
                   'season (season_temperature, season_trend, '
                   'season_none), or a YAML file; list: print their names')
    what.add_argument('--drifts', choices=('paper', 'random'), default='paper',
                        help="of the zero at each power-on: those that give the paper's errors "
                        'before calibration (default), or random ones of that scatter')
    parser.add_argument('--stars', type=options.whole(8, 500),
                        default=options.Default('telescope_mount.observing.plan.BLOCK_STARS'),
                        help='in each of the two blocks of a night (default: %(default)s)')
    options.add(parser, 'polaris', type=options.whole(2, 500))
    parser.add_argument('--satellite', type=options.whole(2, 200), default=20,
                        help='exposures of the satellite before and after (default: 20)')
    options.add(parser, 'domain')
    options.add_verbose(parser, 'nights and tables')
    options.add_json(parser, 'the report')


def run(args):
    """Observe, print, write."""
    from calibration.report.terminal_layout import layered
    from calibration.report.zero_season_report import season_lines, season_table
    from telescope_mount.papers.table_1 import experiment_tables, short_lines, short_table

    from ..commands.console import ProgressLine, end_of_night, new_console, print_all
    from .experiment import run_experiment
    if options.is_list(args):
        return options.list_scenarios(args, 'season_*')
    console = new_console()
    with ProgressLine(console) as progress:
        report = run_experiment(
            args.out, seed=args.seed, drifts=args.drifts, stars=args.stars, polaris=args.polaris,
            satellite=args.satellite, nights=args.nights, scenario=args.scenario,
            domain_number=args.domain, progress=progress)
    print_all(console, layered(
        [short_table(report), *short_lines(report),
         *(f'alarm: {line}' for line in report['alarms'])],
        [f'zeros: {line}' for line in season_lines(report['zeros'])],
        args.verbose, len(report['files']),
        [*experiment_tables(report), season_table(report['zeros'])]))
    return end_of_night(console, args.json, report, 17)
