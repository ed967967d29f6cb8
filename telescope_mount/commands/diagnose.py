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

"""The command ``diagnose``: what is wrong with a mount."""

from functools import partial
from pathlib import Path

from . import options
from .console import (
    ProgressLine,
    check_reader,
    files_of,
    new_console,
    print_all,
    print_finding,
    print_lines,
    refusal_as_json,
    write_outputs,
)

BASES = ('physical, standard6, index, sh13 (or sh1 to sh4; sh4p: E as printed), or terms, '
         'joined by +')


def add(commands):
    """Add the parser."""
    parser = commands.add_parser(
        'diagnose', help='find what a pointing model lacks, on logs and measured runs',
        description='Fit the declared model to pointing runs, examine the residuals, and name the '
        'physical effect that explains them. The improvement is cross-validated, with the effects '
        're-selected per fold.')
    parser.add_argument('runs', nargs='+', type=options.log_path, metavar='RUN',
                        help=f'of one mount: each a {options.RUNS}')
    parser.add_argument('--base', default='physical', metavar='MODEL',
                        help=f'what the model has already: {BASES} (default: physical); or a '
                        'model file, ours or of another program, whose terms are fitted anew')
    parser.add_argument('--own', type=options.names, metavar='TERMS', help='terms that each run '
                        'or session fits for itself (default: of several, IA,IE and what pays)')
    options.add(parser, 'sessions', help='a longer gap begins a session with separate terms. none: '
                'no sessions. auto (default): at gaps of hours, and where revisited places show a '
                'step, if the data support it')
    parser.add_argument('--graduation', metavar='NAME=LINES', help='lines or bars per turn of '
                        'the encoders, such as grating=47200 or az.grating=47200,el.bars=1080: '
                        'outliers by whole ones are slips. Default: from a log of ours. '
                        'tape=LINES, of a tape on a drum: searched within 1 %%')
    parser.add_argument('--worm', metavar='AXIS=TEETH', help='teeth of a worm wheel, such as '
                        'ha=180 or az=360,el=288: its periodic error is looked for there (default: '
                        'periods are searched, 10 to 1000 a turn)')
    parser.add_argument('--cause', action='append', default=[], metavar='COLUMN', help='a column '
                        'of the file that may be a cause, though its name does not say so')
    parser.add_argument('--horizon', type=options.horizon, default=(), metavar='CORNERS',
                        help="the site's skyline, as azimuth and elevation of its corners: "
                        '0 12, 45 20.5, 180 8; or a file with one on each line: nothing behind it '
                        'is proposed')
    options.add(parser, 'alpha')
    parser.add_argument('--holdout', nargs='+', type=options.log_path, default=[], metavar='RUN',
                        help='judge on these as well; only the terms of --own (or IA,IE) are '
                        'refitted there, as on a new night')
    options.add_outputs(parser, save='the model with what was found')
    options.add(parser, 'exclude', 'encoder', *options.OF_RUNS)
    options.add(parser, 'seed', default=0, help='of the resampling (default: 0)')
    options.add(parser, 'jobs')
    parser.add_argument('--verbose', action='store_true', help='print all details too: evidence, '
                        'figures of each axis, notes on the file, what to observe next')


def run(args):
    """Load, diagnose, print, write."""
    with refusal_as_json(args.json, 'refused_document'):
        return _run(args)


def _run(args):
    from calibration.analysis.diagnosis.diagnosis import diagnose
    from calibration.analysis.diagnosis.mistaken_columns import check_columns
    from calibration.analysis.sky_model import settled_together
    from msg_tools.forks import cores

    from ..input_files.run_loader import load_runs
    console = new_console()
    place = options.place_of(args) | {
        'graduation': args.graduation, 'worms': args.worm, 'drivers': args.cause}
    if args.exclude and len(args.runs) > 1:
        raise ValueError('--exclude counts the rows of one file; give one run')
    runs, empty = load_runs(args.runs, **place, exclude=args.exclude)
    held, empty_held = load_runs(args.holdout, runs, **place) if args.holdout else (None, [])
    print_lines(console, 'note', [*empty, *empty_held])
    for one in runs:
        if args.horizon:
            one.meta['skyline'] = args.horizon
    # before minutes of work
    checked = [check_columns(each or (), args.encoder) for each in (runs, held)]
    base = _base_file(args.base, runs[0].mount)
    if base:
        runs, held = ([base.taken_off(base.matched(run), args.encoder) for run in each]
                      if each else each for each in (runs, held))
    else:
        (runs, held), origin = settled_together(runs, held, encoder=args.encoder)
        if origin is not None:
            from calibration.report.fit_wording import origin_sentence
            print_lines(console, 'sides of the pier', [origin_sentence(origin)])
    with ProgressLine(unit='folds', first='looking for effects', lines=True) as line:
        def progress(*step):
            line(*step)
            if not files_of(args):
                check_reader()
        found = diagnose(runs, '+'.join(base.terms) if base else args.base, args.alpha,
                         holdout=held, own_terms=args.own, encoder=args.encoder, seed=args.seed,
                         sessions=args.sessions, progress=progress, jobs=args.jobs or cores(),
                         first_answer=partial(print_finding, console), checked=checked)
    # not before: the first answer would wait for it
    from calibration.report.diagnosis_terminal import diagnosis_tables, summary_lines
    from calibration.report.diagnosis_view import view_of
    from calibration.report.documents import run_diagnosis_document
    found.whole = not (base and base.held is not None)
    document = run_diagnosis_document(found)
    view = view_of(found, document)
    print_all(console, summary_lines(view))
    if args.verbose:
        print_all(console, ['', *diagnosis_tables(view)])
    if base:
        from calibration.report.terminal_tables import base_table
        from calibration.report.wording import wording
        console.print(base_table(base, found.model))
        print_lines(console, 'note', map(wording, base.notes))
        document['base_model'] = base.compared(found.model)
    if args.save and not args.verbose:
        from calibration.report.wording import wording
        print_lines(console, 'note', [wording(one) for one in found.notes
                                      if getattr(one, 'kind', '') == 'medians of the runs'])
    model = base.whole(found.model) if base else found.model
    page = None
    if args.report:
        from calibration.report.diagnosis_page import render
        page = render(view, args.runs)
    write_outputs(console, args, document, model=model.save, page=page)
    return 2 if found.verdict == 'refused' else 0


def _base_file(text, mount):
    """The model file that declares the base, if ``--base`` names one."""
    if '/' not in text and not Path(text).suffix:
        from calibration.analysis.diagnosis.base_terms import Base
        try:
            Base.parse(text, mount=mount)
            return None
        except ValueError:
            if not Path(text).is_file():
                raise
    from calibration.analysis.base_model import BaseModel
    return BaseModel.read(text, mount)
