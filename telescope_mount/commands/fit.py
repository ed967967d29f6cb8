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

"""The command ``fit``."""

from . import options


def add(commands):
    """Add the parser."""
    parser = commands.add_parser(
        'fit', help='fit pointing terms to a measured run',
        description='Read a pointing run and print the terms and '
        'the error before and after.')
    parser.add_argument('file', type=options.log_path, metavar='RUN',
                        help=f'a {options.RUNS}')
    parser.add_argument('--terms', type=options.names, help='comma-separated (default: the seven '
                        'physical terms of the mount)')
    options.add(parser, 'exclude', 'encoder', *options.OF_RUNS)
    parser.add_argument('--predict', action='store_true', help='add whatever predicts '
                        'left-out blocks of time (effects, steps, drift), without naming a cause')
    parser.add_argument('--run', dest='number', type=options.whole(-10**6, 10**6), metavar='N',
                        help='of several runs in the file (column run) the one of this number')
    options.add(parser, 'sessions', default=0.0, help='a longer gap begins a session with '
                'separate zeros. auto: at gaps of hours, and where revisited places show a step, '
                'if the data support it. none (default): one zero')
    options.add(parser, 'harmonics', 'harmonics-alone', 'harmonics-degree')
    parser.add_argument('--no-robust', action='store_true', help='plain least squares')
    parser.add_argument('--max-iterations', type=options.whole(1, 10000), default=30, metavar='N',
                        help='of the fit, before it is given up (default: 30)')
    parser.add_argument('--base', type=options.model_path, metavar='MODEL',
                        help='a model file, ours or of '
                        'another program: its terms are fitted anew, its values shown beside')
    options.add_verbose(parser, 'tables and notes')
    options.add_outputs(parser)


def run(args):
    """Load, fit, print, write."""
    from .console import refusal_as_json
    with refusal_as_json(args.json, 'refused_fit'):
        _run(args)


def _run(args):
    harmonics = options.harmonics_of(args)
    if args.predict:
        options.refuse(args, 'changes nothing of --predict, which makes its own robust choice of '
                       'terms for one session; leave it out',
                       harmonics='none', no_robust=False, sessions=0.0)
    if args.base and args.terms:
        raise ValueError('--base and --terms both say which terms to fit; leave one out')
    from calibration.analysis.harmonic_fit import choice_of
    from calibration.analysis.run_fit import fit_run, one_of_runs
    from calibration.report.documents import fit_document
    from calibration.report.fit_page import render_fit
    from calibration.report.fit_tables import fit_tables

    from ..input_files.run_loader import load_run
    from ..nights.night_files import is_log
    from .console import files_of, new_console, print_all, write_outputs
    # in our own logs the zeros of the power-ons are known, and subtracted
    run = load_run(args.file, **options.place_of(args), exclude=args.exclude)
    run = one_of_runs(run, args.number, args.sessions != 0.0 or is_log(args.file))
    base = None
    if args.base:
        from calibration.analysis.base_model import BaseModel
        base = BaseModel.read(args.base, run.mount)
    found = fit_run(run, args.terms, encoder=args.encoder, robust=not args.no_robust, base=base,
                    harmonics=harmonics and choice_of(harmonics), predict=args.predict,
                    source=args.file, sessions=args.sessions,
                    most_iterations=args.max_iterations)
    console, document = new_console(), fit_document(found)
    print_all(console, fit_tables(found, document, args.verbose, files_of(args)))
    write_outputs(console, args, document, model=found.model.save,
                  page=args.report and render_fit(found, document))
