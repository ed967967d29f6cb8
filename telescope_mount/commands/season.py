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

"""The command ``season``."""

from . import options


def add(commands):
    """Add the parser."""
    parser = commands.add_parser(
        'season', help="the terms night by night, what moves them, and what tonight's will be",
        description='Fit the pointing runs of many nights (any kind that fit takes). Print how the '
        'terms drift, what moves them (temperature, time, an unreported step) and the terms '
        'predicted for a night to come.')
    parser.add_argument('files', type=options.log_path, metavar='RUN', nargs='+',
                        help='files, logs, or folders of files')
    parser.add_argument('--terms', type=options.names, help='comma-separated (default: the seven '
                        'physical terms of the mount)')
    parser.add_argument('--since', action='append', default=[], metavar='DATE[=TEXT]',
                        help='something was done to the mount then; may be given again')
    parser.add_argument('--tonight', action='append', default=[], metavar='DATE|COLUMN=VALUE',
                        help='the night to predict (default: a day after the last), and what '
                        'is known of it, such as temperature=4.5; may be given again')
    parser.add_argument('--cause', action='append', default=[], metavar='COLUMN',
                        help='a column that may move the mount though its name does not say so')
    options.add(parser, *options.OF_RUNS)
    options.add_verbose(parser, 'causes and notes')
    options.add_outputs(parser, save='the predicted model')


def run(args):
    """Read, fit, judge, print, write."""
    from calibration.analysis.season.season_analysis import analyse_season
    from calibration.analysis.season.season_nights import nights_of
    from calibration.report.season_page import render_season
    from calibration.report.terminal_layout import layered
    from calibration.report.wording import noted, worded
    from msg_tools.iso_time import iso_seconds
    from pointing_model.runs.columns.run_table import NoObservations

    from ..input_files.run_loader import load_run
    from .console import ProgressLine, files_of, new_console, print_all, write_outputs
    declared = []
    for text in args.since:
        date, _, what = text.partition('=')
        declared.append((iso_seconds(date), what.strip() or f'what was done on {date}'))
    tonight, causes = None, {}
    for text in args.tonight:
        name, sign, value = text.partition('=')
        if sign:
            try:
                causes[name.strip()] = float(value)
            except ValueError:
                raise ValueError(f'--tonight {text}: {value!r} is no number') from None
        else:
            tonight = iso_seconds(name)
    console, runs, empty = new_console(), [], []
    files = list(_files(args.files))
    with ProgressLine(unit='runs', first='reading') as progress:
        for number, path in enumerate(files):
            progress('reading', number, len(files))
            try:
                runs.append(load_run(path, **options.place_of(args)))
            except NoObservations as err:
                empty.append(f'left out: {err}')
        progress(f'fitting {len(runs)} nights')
        season = nights_of(runs, args.terms, args.cause)
        season.notes.extend(empty)
        progress('looking for what moves the terms')
        result = analyse_season(season, declared=declared, tonight=tonight, causes=causes)
    document = worded(result.document())
    cautions, notes = noted(result.document()['notes'])
    found = worded(result.findings()) or [
        'no cause found; how far each term drifts is in the table']
    print_all(console, layered(
        [_table(document), *cautions],
        [*(f'found: {line}' for line in found), *notes], args.verbose, files_of(args)))
    write_outputs(console, args, document, model=result.model().save,
                  page=args.report and render_season(result, args.files))


def _files(paths):
    """The given paths; for a folder that is not a log, the files and nights in it."""
    from ..nights.night_files import holds_log
    for path in paths:
        if path.is_dir() and not holds_log(path):
            logs = (options.log_path(p) for p in path.iterdir() if p.name[0] != '.')
            inside = sorted(p for p in logs if p.is_file() or holds_log(p))
            if not inside:
                raise ValueError(f'{path} is empty: name pointing runs')
            yield from inside
        else:
            yield path


def _table(document):
    from calibration.report.terminal_tables import new_table
    nights = document['nights']
    predicted, drift = document['tonight'], document['wander']
    out = new_table(f'{len(nights)} nights, {nights[0]["time"][:10]} to '
                    f'{nights[-1]["time"][:10]}; predicted for {predicted["time"]}, arcsec', 'term',
                    'predicted', 'last night', 'drift per √day', 'scatter by night')
    for name in document['terms']:
        out.add_row(name, *(f'{of["terms_arcsec"][name]:+.1f} ± {of["sigma_arcsec"][name]:.1f}'
                            for of in (predicted, nights[-1])),
                    f'{drift[name]["walk_arcsec_per_root_day"]:.2f}',
                    f'{drift[name]["night_arcsec"]:.1f}')
    return out
