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

"""The command ``solve``: converts a folder of images to a pointing run."""

from pathlib import Path

from . import options


def add(commands):
    """Add the parser."""
    parser = commands.add_parser(
        'solve', help='solve a folder of images with an installed plate solver',
        description='Run a plate solver (solve-field of astrometry.net, or astap) over the FITS '
        'images of a folder. Write a pointing run that fit and diagnose read. What is solved is '
        'not solved again: after an interruption give the same command.')
    parser.add_argument('folder', type=Path, metavar='FOLDER')
    parser.add_argument('--keywords', type=Path, metavar='FILE.yaml', help='which keywords of the '
                        'images are what (default: FOLDER/mount.yaml)')
    parser.add_argument('--out', type=Path, metavar='FILE.csv',
                        help='the run (default: FOLDER/solved.csv)')
    parser.add_argument('--solver', metavar='NAME', help=f'{options.SOLVERS}, or the '
                        'path of one (default: the first that is installed)')
    parser.add_argument('--timeout', type=options.real(1.0, 36000.0, 's'), metavar='S',
                        default=options.Default('pointing_model.runs.plate_solves.solvers.TIMEOUT'),
                        help='for one image (default: %(default)s)')
    parser.add_argument('--scale', nargs=2, type=options.real(1e-3, 3600.0, 'arcsec'),
                        metavar=('LOW', 'HIGH'), help='arcsec a pixel: makes a solver faster, '
                        'and surer')
    parser.add_argument('--again', action='store_true',
                        help='try images that were not solved once more')
    options.add_json(parser, 'how many were solved')


def run(args):
    """Solve, report each image, count."""
    from pointing_model.runs.plate_solves.mapping import load_mapping
    from pointing_model.runs.plate_solves.solvers import find_solver

    from ..input_files.image_folder import FAILED, HUNG, SOLVED, solve_folder
    from .console import ProgressLine, new_console, print_files, print_lines, write_outputs
    if not args.folder.is_dir():
        raise ValueError(f'{args.folder} is no folder of images')
    if args.scale and args.scale[0] > args.scale[1]:
        raise ValueError('--scale: the first is the lower one')
    out = args.out or args.folder / 'solved.csv'
    options.check_target(out, ('.csv',))
    mount = args.keywords or args.folder / 'mount.yaml'
    if not mount.exists():
        raise ValueError(f'{mount} is not there: it says which keywords of the images are what '
                         '(docs/plate_solved.md has one to copy); --keywords names another')
    mapping = load_mapping(mount)
    solver = find_solver(args.solver, args.timeout, tuple(args.scale) if args.scale else None)
    console = new_console()
    with ProgressLine(unit='images', first='looking for images') as progress:
        counts = solve_folder(args.folder, mapping, solver, out, again=args.again,
                              report=console.print, progress=progress)
    total = sum(counts.values())
    console.print(f'{counts[SOLVED]} of {total} images solved, {counts[FAILED]} not, on '
                  f'{counts[HUNG]} the solver hung')
    print_files(console, {'run': out})
    mistaken, notes = _column_doubts(out) if counts[SOLVED] else (False, [])
    print_lines(console, 'note', notes)
    write_outputs(console, args, {**counts, 'images': total, 'run': out})
    return 0 if counts[SOLVED] == total and not mistaken else 1


def _column_doubts(path):
    """Whether clock, site or readings of a run are wrong, and remarks on them, lines."""
    from calibration.analysis.diagnosis.mistaken_columns import MistakenColumns, check_columns
    from calibration.report.wording import wording

    from ..input_files.run_loader import load_run
    try:
        run = load_run(path)
        return False, [wording(one) for one in check_columns(run).doubts(run.mount.names)]
    except MistakenColumns as error:
        return True, [str(error)]
    except ValueError:  # not a run yet, for instance images without readings
        return False, []
