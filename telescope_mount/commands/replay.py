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

"""The command ``replay``."""

from . import options

#: see `telescope_mount.missing_ros`
NEEDS_ROS = True


def add(commands):
    """Add the parser."""
    parser = commands.add_parser(
        'replay', help='replay a log into a fresh calibration',
        description='Publish a log again, calibrate on it, and print the same tables.')
    parser.add_argument('log', type=options.log_path, metavar='BAG')
    options.add(parser, 'reference', help='the reference model, if the night had one')
    options.add(parser, 'seed',
                help='of the choice of held-out stars; that of the night (default: 1)')
    options.add(parser, 'harmonics', default=None, help="paper 000's spherical harmonics in the "
                'model, by how their E is read (default: as the night had them)')
    options.add(parser, 'harmonics-alone', 'harmonics-degree')
    options.add_verbose(parser, 'tables and notes')
    options.add_outputs(parser, 'the report', report=False)
    options.add(parser, 'domain')


def run(args):
    """Replay, print, write."""
    from ..log_check.log_replay import replay_log
    from .console import (
        ProgressLine,
        files_of,
        new_console,
        print_calibration,
        print_files,
        print_lines,
        write_outputs,
    )
    if args.reference is not None:
        from pointing_model.model import PointingModel
        PointingModel.load(args.reference)
    given = args.harmonics or args.harmonics_alone or args.harmonics_degree
    args.harmonics = args.harmonics or 'none'
    harmonics = {'harmonics': 'none', **options.harmonics_of(args)} if given else None
    console = new_console()
    with ProgressLine(unit='rows') as progress:
        report = replay_log(args.log, reference=args.reference, seed=args.seed, out=args.save,
                            domain_number=args.domain, harmonics=harmonics, progress=progress)
    print_calibration(console, report, args.verbose, files_of(args) + 1)
    print_lines(console, 'problem', report['problems'])
    if report['diagnosis']:
        from pointing_model.effects.base import readable
        found = report['diagnosis']
        added = ', '.join(map(readable, found['applied'])) or '–'
        print_files(console, {'diagnosis': f'{found["verdict"]}: {added}'})
    if args.save:
        print_files(console, {'model': args.save})
    write_outputs(console, args, report, 'report')
