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

"""The command ``encoder-test``."""


from pathlib import Path

from ..commands import options


def add(commands):
    """Add the parser."""
    parser = commands.add_parser(
        'encoder-test', help="the 23-face test of the absolute encoder, beside the paper's",
        description='Turn the simulated disc of the absolute encoder to 23 standard angles. Read '
        "it by the paper's method, its two rivals and ours, and compare with the printed values.")
    options.add_out(parser, 'encoder_test', 'the page')
    options.add_verbose(parser, 'tables and notes')
    options.add_json(parser, 'all figures')
    options.add(parser, 'seed', help='of disc, table and noise (default: 1)')
    parser.add_argument('--turns', type=options.whole(2, 1000), default=20,
                        help='of 23 angles each (default: 20)')
    parser.add_argument('--pitch', type=int, choices=(48, 60), default=48,
                        help='pixels a bar (default: 48)')


def run(args):
    """Turn, read, print."""
    from calibration.report.terminal_layout import layered
    from msg_tools.whole_files import write_text

    from ..commands.console import (
        ProgressLine,
        files_of,
        new_console,
        print_all,
        print_files,
        write_outputs,
    )
    from . import encoder_test
    from .encoder_page import render_encoder_test
    console, page = new_console(), args.out / 'page.html'
    options.refuse_existing(page, args)
    args.out.mkdir(parents=True, exist_ok=True)
    with ProgressLine(first='turning the disc') as progress:
        report = encoder_test.run(args.seed, args.turns, args.pitch, progress)
    first, *rest = encoder_test.tables(report)
    print_all(console, layered([first], [f'note: {note}' for note in encoder_test.notes(report)],
                               args.verbose, 1 + files_of(args), rest))
    write_outputs(console, args, report, 'figures')
    figures = [args.json] if isinstance(args.json, Path) else []
    write_text(page, render_encoder_test(report, figures))
    print_files(console, {'page': page})
