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

"""The command ``satellite``: a model, a clock and orbits from tracks of satellites."""

from pathlib import Path

from . import options


def add(commands):
    """Add the parser."""
    parser = commands.add_parser(
        'satellite', help='terms, clock and orbit errors from tracks of satellites',
        description='Read tracks of satellites (CSV: time, encoder angles, miss distance, or '
        'observed places) and their precise orbits or elements. Fit the terms of the mount, '
        "the station's clock and what is known of each orbit. Name a wrong orbit, and "
        'diagnose the residuals like those of stars.')
    parser.add_argument('tracks', nargs='+', type=Path, metavar='TRACK', help='CSV files, or logs '
                        'of nights with passes')
    options.add(parser, 'orbit')
    parser.add_argument('--object', metavar='ID', help='the satellite of rows that name none (no '
                        'column satellite): L52, G18, a catalogue number')
    parser.add_argument('--star-run', dest='stars', action='append', default=[],
                        type=options.log_path, metavar='RUN', help='a pointing run of stars that '
                        'goes into the same fit; may be given again')
    parser.add_argument('--model', type=options.model_path, metavar='MODEL', help='prior of '
                        'the terms, with its covariance; the zeros of the axes are fitted anew')
    parser.add_argument('--terms', type=options.names, help='comma-separated (default: the seven '
                        'physical terms of the mount, or those of the model)')
    parser.add_argument('--clock', type=options.real(0.0, 1e4, 's'), metavar='S', help='1-sigma '
                        'uncertainty of the station clock; 0: exact (default: unknown)')
    parser.add_argument('--time-bias', action='append', default=[], metavar='ID', help='a '
                        'satellite whose time bias along its orbit is fitted without a prior; '
                        'may be given again')
    parser.add_argument('--verbose', action='store_true', help='print all details of the '
                        'diagnosis too')
    parser.add_argument('--no-diagnosis', action='store_true', help='do not diagnose the residuals')
    options.add(parser, 'mount', 'latitude', 'longitude', 'height')
    options.add(parser, 'pressure', 'temperature', help='of the air, where the rows do not have it')
    options.add_outputs(parser)


def run(args):
    """Read, fit, diagnose, print, write."""
    from calibration.analysis.satellites.stamp_check import wrong_track
    from calibration.analysis.satellites.track_faults import fit_without_faults
    from calibration.analysis.satellites.track_fit import with_origin
    from calibration.analysis.satellites.track_summary import track_document
    from calibration.report.fit_wording import origin_sentence
    from calibration.report.satellite_page import render_tracks, tracks_table
    from calibration.report.terminal_layout import layered
    from calibration.report.terminal_tables import terms_table
    from calibration.report.wording import worded, wording
    from pointing_model.model import PointingModel

    from ..input_files.track_loader import load_tracks
    from .console import ProgressLine, files_of, new_console, print_all, write_outputs
    args.azimuth_origin, args.equinox = None, 'auto'
    place = options.place_of(args)
    measured = load_tracks(args.tracks, args.orbit, args.object, args.stars, site=place.get('site'),
                           weather=place.get('weather'), mount=args.mount)
    bias_free = tuple(_named(measured, one) for one in args.time_bias)
    found = wrong_track(measured, bias_free)
    if found is not None:
        raise ValueError(f'{args.tracks[0]}: {wording(found)}')
    held = args.model and PointingModel.load(args.model)
    console = new_console()
    with ProgressLine(first='fitting the tracks'):
        tracks, origin = with_origin(measured.tracks())
        fit = fit_without_faults(
            tracks, terms=args.terms, held=held,
            clock_sigma=float('inf') if args.clock is None else args.clock, bias_free=bias_free)
    document = track_document(fit)
    document['notes'] = [*document['notes'], *measured.notes,
                         *([origin_sentence(origin)] if origin else [])]
    view = None
    if not args.no_diagnosis and document['determined']:
        view = _diagnosed(fit, document)
    document = worded(document)
    left = []
    if view is not None:
        from calibration.report.diagnosis_terminal import diagnosis_tables, summary_lines
        left = summary_lines(view)
        left[0] = f'residuals, 2-minute means: {left[0]}'
        left += diagnosis_tables(view) if args.verbose else ()
    print_all(console, layered(
        [terms_table(document['terms']), *_lines(document)],
        [*left, *(f'note: {note}' for note in document['notes'])], args.verbose, files_of(args),
        [tracks_table(document)]))
    files = [*args.tracks, *args.stars, *args.orbit]
    write_outputs(console, args, document, model=fit.model.save,
                  page=args.report and render_tracks(fit, document, view, files))


def _named(measured, text):
    for name, orbit in measured.orbits.items():
        if text.strip().upper() in (name.upper(), str(getattr(orbit, 'number', ''))):
            return name
    raise ValueError(f'--time-bias {text}: no track of it; tracked: {", ".join(measured.orbits)}')


def _diagnosed(fit, document):
    """View of the diagnosis of the residuals; None if there are too few points."""
    from calibration.analysis.diagnosis.diagnosis import diagnose
    from calibration.analysis.satellites.normal_points import normal_points
    from calibration.report.diagnosis_view import view_of
    from calibration.report.documents import run_diagnosis_document
    from msg_tools.forks import cores

    from .console import ProgressLine
    try:
        with ProgressLine(unit='folds', first='looking for effects', lines=True) as progress:
            found = diagnose([normal_points(fit)], '+'.join(fit.model.terms), sessions=0.0,
                             progress=progress, jobs=cores())
    except ValueError as error:
        document['notes'].append(f'not diagnosed: {error}')
        return None
    of = run_diagnosis_document(found)
    document['diagnosis'] = of
    return view_of(found, of)


def _lines(document):
    before, after = document['before'], document['after']
    yield (f'{document["rows"]} rows, RMS on the sky {before["radial_arcsec"]:.2f}" -> '
           f'{after["radial_arcsec"]:.2f}"; model uncertainty '
           f'{document["sky_sigma_arcsec"]:.2f}" over the sky (1 sigma)')
    if 'clock' in document:
        clock = document['clock']
        yield (f'clock: {1e3 * clock["late_s"]:+.1f} ± {1e3 * clock["sigma_s"]:.1f} ms '
               '(positive: stamps are late)')
