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

"""The command ``bolts``: which bolt, shim or foot of a mount to move, which way, how far."""

import argparse
from pathlib import Path

from . import options


def add(commands):
    """Add the parser."""
    parser = commands.add_parser(
        'bolts', help='which bolt of the mount to turn, which way and how far',
        description='From the terms of a model or run: bolts of an equatorial mount, shim for its '
        'cone error, feet of an alt-azimuth mount. With --live: the '
        'remaining error, image by image, while you turn them.')
    parser.add_argument('file', type=options.log_path, nargs='?', metavar='MODEL|RUN',
                        help='a model file of ours (.json, .yaml), or a run to fit; with --live '
                        'it may be left out')
    parser.add_argument('--pole', choices=('true', 'refracted'), default='true',
                        help='pole to align to (default: true; the refracted one is higher)')
    parser.add_argument('--per-turn', type=_pair, metavar='AZ,ALT', help='arcmin that one turn '
                        'of the azimuth bolt, and of the altitude bolt, moves the axis')
    parser.add_argument('--saddle', type=options.real(1.0, 1e5, 'mm'), metavar='MM',
                        help='distance of the points that carry the tube: for a shim against the '
                        'cone error')
    parser.add_argument('--feet', type=_feet, metavar='RADIUS,N[,AZIMUTH]', help='of an '
                        'alt-azimuth mount: radius of the circle of feet in mm, how many, azimuth '
                        'of the first (default: 3 feet, the first in the north)')
    parser.add_argument('--live', metavar='FOLDER', help='watch a folder of images, '
                        'solved or not, and print the remaining error after each; '
                        'indi:HOST[:PORT[:CAMERA]] takes them with a camera of an INDI server')
    parser.add_argument('--exposure', type=options.real(1e-3, 600.0, 's'), metavar='S',
                        default=options.Default('telescope_mount.live_bolts.EXPOSURE'),
                        help='of that camera (default: %(default)s)')
    parser.add_argument('--keywords', type=Path, metavar='FILE.yaml', help='with --live: which '
                        'keywords of the images are what (default: FOLDER/mount.yaml)')
    parser.add_argument('--solver', metavar='NAME', help='with --live: '
                        f'{options.SOLVERS}, or the path of one, for images without a solution')
    parser.add_argument('--scale', nargs=2, type=options.real(1e-3, 3600.0, 'arcsec'),
                        metavar=('LOW', 'HIGH'), help='with --live: arcsec a pixel, which makes a '
                        'solver faster')
    parser.add_argument('--every', type=options.real(0.1, 600.0, 's'), metavar='S',
                        default=options.Default('telescope_mount.live_bolts.EVERY'),
                        help='with --live: how often the folder is looked at '
                        '(default: %(default)s)')
    parser.add_argument('--for', dest='patience', type=options.real(0.0, 86400.0, 's'),
                        default=options.Default('telescope_mount.live_bolts.PATIENCE'),
                        metavar='S', help='with --live: without a new image it '
                        'ends after this (default: %(default)s)')
    parser.add_argument('--within', type=options.real(0.1, 36000.0, 'arcsec'),
                        default=options.Default('telescope_mount.live_bolts.WITHIN_ARCSEC'),
                        metavar='ARCSEC', help='with --live: stop when three images after a turn '
                        'show the axis this close to the pole (default: %(default)s)')
    options.add(parser, 'encoder', *options.OF_RUNS)
    options.add_verbose(parser, 'notes')
    options.add_json(parser, 'where the axis points, and what to turn')


def _numbers(text, least, most, words):
    try:
        values = [float(part) for part in text.split(',')]
    except ValueError:
        values = []
    if not least <= len(values) <= most or not all(abs(v) < 1e7 for v in values):
        raise argparse.ArgumentTypeError(f'{text!r}: write {words}')
    return values


def _pair(text):
    values = _numbers(text, 2, 2, 'AZ,ALT in arcmin, as 31,44')
    if not min(values) > 0.0:
        raise argparse.ArgumentTypeError(f'{text!r}: both must be more than 0 arcmin')
    return values


def _feet(text):
    given = _numbers(text, 1, 3, 'RADIUS,N,AZIMUTH, as 1200,3,0')
    radius, count, first = *given, *(3.0, 0.0)[len(given) - 1:]
    if not radius > 0.0 or count < 3 or count != int(count) or count > 1000:
        raise argparse.ArgumentTypeError(f'{text!r}: write a radius in mm > 0 and 3 to 1000 feet')
    return radius, int(count), first


def run(args):
    """Read or fit, print what to turn."""
    if args.live is not None:
        from ..live_bolts import live
        return live(args)
    options.refuse(args, 'needs --live FOLDER', keywords=None, solver=None, scale=None)
    if args.file is None:
        raise ValueError('give a model or a run; or a folder of images with --live')
    from calibration.report.terminal_layout import layered

    from .console import files_of, new_console, print_all, write_outputs
    model, notes, equinox = model_of(args)
    document, lines = alignment_of(model, args, equinox)
    console = new_console()
    print_all(console, layered(lines, [f'note: {note}' for note in notes], args.verbose,
                               files_of(args)))
    write_outputs(console, args, {**document, 'lines': lines, 'notes': notes})
    return None


def model_of(args):
    """Model of the file, or fitted to the run in it; notes; equinox of a run."""
    from pointing_model.runs.model_reader import is_ours, read_model
    if is_ours(args.file):
        model = read_model(args.file).model
        options.check_mount(args, args.file, model.mount)
        options.refuse(args, 'applies to runs; leave it out with a model', encoder='enc',
                       azimuth_origin=None, equinox='auto')
        return model, [], None
    from calibration.analysis.run_fit import fit_run, one_of_runs
    from calibration.report.wording import wording

    from ..input_files.run_loader import load_run
    run = load_run(args.file, **options.place_of(args))
    found = fit_run(one_of_runs(run, None, args.file.is_dir()), encoder=args.encoder,
                    source=args.file)
    return found.model, list(map(wording, found.findings)), run.meta.get('equinox_taken')


def refraction_of(args, latitude):
    """Height of the chosen pole above the true one, rad."""
    if args.pole == 'true':
        return 0.0
    from pointing_model.sky.refraction import air_at, refracted_elevation
    weather = air_at(args.height or 0.0, options.given_air(args))
    return float(refracted_elevation(abs(latitude), weather) - abs(latitude))


def alignment_of(model, args, equinox=None):
    """What to move, as a document and as lines."""
    import numpy as np

    from calibration.report.bolt_wording import (
        alignment_document,
        alignment_lines,
        feet_lines,
        shim_line,
    )
    from pointing_model.bolts_and_feet import cone_shim, foot_lifts
    document, lines = {}, []
    if model.mount.celestial:
        found = alignment_document(model, refraction_of(args, model.mount.latitude), equinox)
        if found['unknown']:
            raise ValueError(found['unknown'])
        document['polar_axis'] = found
        lines += alignment_lines(found, args.per_turn and [60.0 * v for v in args.per_turn])
    elif args.per_turn:
        raise ValueError('--per-turn applies to equatorial mounts only; leave it out')
    if args.saddle:
        shim = cone_shim(model, args.saddle)
        document['shim'] = {
            'end': 'rear' if shim.rear else 'front', 'thickness_mm': shim.thickness,
            'sigma_mm': shim.thickness_sigma}
        lines.append(shim_line(shim))
    if args.feet:
        radius, count, first = args.feet
        feet = foot_lifts(model, radius, np.deg2rad(first + 360.0 * np.arange(count) / count))
        document['feet'] = [
            {'azimuth_deg': float(az) % 360.0, 'lift_mm': lift, 'sigma_mm': sigma}
            for az, lift, sigma in zip(np.rad2deg(feet.azimuths), feet.lifts.tolist(),
                                       feet.sigmas.tolist())]
        lines += feet_lines(feet)
    if not lines:
        raise ValueError('this mount has no polar axis: give the circle of its feet '
                         '(--feet RADIUS,N,AZIMUTH), or --saddle for the cone error')
    return document, lines
