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

"""The command ``apply``: directions to encoder angles by a model, and back."""

import sys
from pathlib import Path

from msg_tools.whole_files import beside

from . import options


def add(commands):
    """Add the parser."""
    parser = commands.add_parser(
        'apply', help='convert directions to encoder angles with a model, or back',
        description='Read a table with the columns az_deg, el_deg (with --reverse: az_enc_deg, '
        'el_enc_deg) and write it with the converted angles in two more columns. From ra_deg, '
        'dec_deg, a time and a site it also writes the observed place. Further columns, named as '
        'in a run (time, temperature_c, approach_az, ...), drive the effects that need them.')
    parser.add_argument('model', type=options.model_path, metavar='MODEL',
                        help='a model file of ours (.json, '
                        '.yaml), or of a program that `export --to` writes')
    parser.add_argument('file', nargs='?', default='-', metavar='FILE',
                        help='CSV with a header row; - (default): from the standard input')
    parser.add_argument('--reverse', action='store_true', help='encoder angles to directions')
    parser.add_argument('--out', type=Path, metavar='FILE', help='write here; else to the '
                        'standard output')
    options.add_overwrite(parser)
    parser.set_defaults(written=('out',))
    parser.add_argument('--time', metavar='UTC', help='UTC of all rows, ISO 8601; overrides a '
                        'column time')
    parser.add_argument('--set', action='append', default=[], metavar='COLUMN=VALUE', dest='given',
                        help='value of a column in all rows, such as temperature_c=4.5')
    parser.add_argument('--zero', type=options.zero, default='newest', metavar='WHICH',
                        help='zero of the model: newest (default; by row, if there is a '
                        'column run), none, or the number of a run')
    options.add(parser, 'latitude', 'longitude', 'height', 'pressure', 'temperature')
    options.add(parser, 'equinox', help='of ra_deg, dec_deg: J2000 (default, with the ICRS), or '
                'apparent places of date')
    options.add(parser, 'mount', help="mount of another program's model: "
                f'{options.MOUNT_KINDS}; equatorial ones need --latitude, and columns ha_deg, '
                'dec_deg ...')


def run(args):
    """Read, convert, write, report what was unknown."""
    from pointing_model.mounts import ALTAZ
    from pointing_model.runs.columns.cells import write_rows
    from pointing_model.runs.model_reader import read_model

    from ..apply_table import apply_to_table
    from .console import new_console, print_lines, step_aside
    loaded = read_model(args.model, options.mount_of(args) or ALTAZ)
    rows, delimiter, notes = apply_to_table(loaded.model, args)
    if args.out:
        with beside(args.out) as part, open(
                part, 'w', newline='', encoding='utf-8') as stream:
            write_rows(stream, rows, delimiter=delimiter)
    else:
        step_aside(for_good=True)
        write_rows(sys.stdout, rows, delimiter=delimiter)
    # on standard error, since the table may be on the standard output
    print_lines(new_console(stderr=True), 'note', [*loaded.notes, *notes])
