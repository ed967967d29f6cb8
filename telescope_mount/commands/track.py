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

"""The command ``track``."""


from . import options


def add(commands):
    """Add the parser."""
    parser = commands.add_parser(
        'track', help='follow a mount through a run that was observed, star by star',
        description='Go through a pointing run (CSV, or a log of ours) in time with an adaptive '
        'model. Print the error of each prediction, what jumped and drifted, and whether the '
        'expected errors hold.')
    parser.add_argument('file', type=options.log_path, metavar='RUN', help='as of fit')
    parser.add_argument('--model', type=options.model_path, metavar='MODEL',
                        help='to begin with (default: fitted to the first stars)')
    parser.add_argument('--first', type=options.whole(4, 100000), metavar='N',
                        help='stars that it is fitted to (default: a third, 12 at least)')
    parser.add_argument('--terms', type=options.names, help='comma-separated, of that fit')
    options.add(parser, *options.OF_RUNS)
    options.add_verbose(parser, 'jumps and notes')
    options.add_outputs(parser, save='the model after the last star')


def run(args):
    """Read, track, print, write."""
    if args.model and (args.first or args.terms):
        raise ValueError('--first and --terms are of a model that is fitted: leave out --model')
    from calibration.analysis.tracking.run_track import track_run
    from calibration.report.terminal_layout import layered
    from calibration.report.terminal_tables import new_table
    from calibration.report.track_page import render_track, tracking_lines
    from calibration.report.wording import noted, worded
    from pointing_model.model import PointingModel

    from ..input_files.run_loader import load_run
    from .console import ProgressLine, files_of, new_console, print_all, write_outputs
    run = load_run(args.file, **options.place_of(args))
    model = args.model and PointingModel.load(args.model)
    with ProgressLine(unit='rows', first='following the mount') as progress:
        tracked = track_run(run, model, args.first, args.terms, progress)
    summary, console = worded(tracked.summary()), new_console()
    missed = summary['missed_rms_arcsec']
    table = new_table('', f'error of {len(tracked.rows)} predicted stars, arcsec', 'RMS', 'median')
    for name, word in (('model of the evening', 'fixed model'), ('tracked', 'adaptive model')):
        table.add_row(word, f'{missed[name]:.2f}', f'{missed[f"{name}, middle"]:.2f}')
    table.add_row('adaptive model, expected', f'{missed["expected"]:.2f}', '')
    of = [f'fixed model: fitted to the first {tracked.fitted} stars'] * bool(tracked.fitted)
    cautions, notes = noted(tracked.summary()['notes'])
    print_all(console, layered(
        [table, *of, *cautions],
        [*(f'tracked: {line}' for line in tracking_lines(summary)), *notes],
        args.verbose, files_of(args)))
    write_outputs(console, args, summary, model=tracked.model.save,
                  page=args.report and render_track(tracked, [args.file]))
