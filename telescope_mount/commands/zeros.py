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

"""The command ``zeros``."""

from pathlib import Path

from . import options


def add(commands):
    """Add the parser."""
    parser = commands.add_parser(
        'zeros', help='what moves the zero between power-ons: temperature, supply, ...',
        description='Read zeros of power-ons, a row each (CSV: zero_az_arcsec, zero_el_arcsec, '
        'temperature_c, supply_v, since_h, side, time), and print what they follow. A last row '
        'without zeros is tonight: its zero is predicted.')
    parser.add_argument('file', type=Path, metavar='FILE',
                        help='CSV with a zero of each power-on (docs/zero_drift.md)')
    options.add_verbose(parser, 'notes')
    options.add_outputs(parser, 'the verdict', save='', report=False)


def run(args):
    """Read, test, print, write."""
    from calibration.report.terminal_layout import layered
    from calibration.report.zero_season_report import season_lines, season_table
    from telescope_mount.input_files.zero_file import zero_file_causes

    from .console import files_of, new_console, print_all, write_outputs
    document = zero_file_causes(args.file)
    console = new_console()
    print_all(console, layered(
        [season_table(document)],
        [*season_lines(document), *(f'note: {note}' for note in document['notes'])],
        args.verbose, files_of(args)))
    write_outputs(console, args, document, 'verdict')
