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

"""The command ``close-the-loop``."""


from . import options

#: see `telescope_mount.missing_ros`
NEEDS_ROS = True


def add(commands):
    """Add the parser."""
    parser = commands.add_parser(
        'close-the-loop', help='find what the model lacks, add it, and prove the gain',
        description='Observe a simulated night with an effect that only the simulator knows, or '
        'take a measured run. Fit, diagnose the residual, add what is found to the model. '
        'Point at fresh stars with it: the miss distance before and after.')
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument('file', nargs='?', type=options.log_path, metavar='RUN',
                      help=f'a measured run: a {options.RUNS}; validated on rows not fitted')
    options.add_scenario(what, help='errors of the simulated mount: a name '
                      '(loop_*, mount_*), a YAML file, a pattern such as "mount_*", "all" for '
                      'every loop_*; "list": print their names')
    options.add_out(parser, 'loop', 'log, model, reports and page')
    options.add(parser, 'seed')
    parser.add_argument('--stars', type=options.whole(12, 5000),
                        default=options.Default('telescope_mount.closed_loop.closed_loop.FITTED'),
                        help='that fit and diagnosis see (default: %(default)s)')
    options.add(parser, 'polaris')
    parser.add_argument('--check', type=options.whole(2, 5000),
                        default=options.Default('telescope_mount.closed_loop.closed_loop.CHECKED'),
                        help='fresh stars pointed at blind, before and after '
                        '(default: %(default)s)')
    parser.add_argument('--check-every', type=options.whole(2, 1000), metavar='N',
                        default=options.Default('telescope_mount.closed_loop.closed_loop.CHECK_EVERY'),
                        help='of a measured run one row in N is kept out (default: %(default)s)')
    options.add(parser, 'alpha', 'date')
    options.add(parser, *[one for one in options.OF_RUNS if one != 'mount'])
    options.add(parser, 'mount', help=options.MOUNT_OF_NIGHT)
    options.add(parser, 'domain')
    options.add_verbose(parser, 'tables and notes')
    options.add_json(parser, 'the report')


def run(args):
    """Observe or read, diagnose, observe again, print, write."""
    from calibration.report.row_wording import expected_sentence, outlier_sentence, used_sentence
    from calibration.report.terminal_layout import layered

    from ..closed_loop.closed_loop import (
        ALL,
        CHECK_EVERY,
        CHECKED,
        FITTED,
        close_all,
        close_the_loop,
    )
    from ..closed_loop.loop_tables import all_table, loop_sentences, loop_tables, short_tables
    from ..observing.plan import ZERO_EXPOSURES
    from .console import ProgressLine, end_of_night, new_console, print_all
    if options.is_list(args):
        return options.list_scenarios(args, 'loop_*', 'mount_*')
    if args.file is None:
        options.refuse(args, 'applies to measured runs; leave it out with a scenario',
                       azimuth_origin=None, pressure=None, temperature=None, equinox='auto',
                       check_every=CHECK_EVERY)
    else:
        options.refuse(args, 'applies to simulated nights; leave it out with a run',
                       stars=FITTED, polaris=ZERO_EXPOSURES, check=CHECKED, date='')
    chosen = {
        'seed': args.seed, 'stars': args.stars, 'polaris': args.polaris, 'check': args.check,
        'alpha': args.alpha, 'start_time': args.date, 'sky': options.sky_of(args),
        'mount': args.mount or '',
        'domain_number': args.domain}
    console = new_console()
    with ProgressLine(console) as progress:
        several = ALL if args.scenario == 'all' else args.scenario or ''
        if set(several) & set('*?['):
            report = close_all(args.out, names=several, progress=progress, **chosen)
        else:
            report = close_the_loop(
                args.out, scenario=args.scenario or '', file=args.file,
                place=options.place_of(args) if args.file else {}, check_every=args.check_every,
                progress=progress, **chosen)
    if 'scenarios' in report:
        console.print(all_table(report))
        return end_of_night(console, args.json, report)
    notes = [expected_sentence(report), outlier_sentence(report), *loop_sentences(report)]
    print_all(console, layered(
        [used_sentence(report), *short_tables(report)], [f'note: {text}' for text in notes if text],
        args.verbose, len(report['files']), loop_tables(report)))
    return end_of_night(console, args.json, report)
