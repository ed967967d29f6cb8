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

"""Types of options, and options shared by several commands."""

import argparse
import os
import sys
from contextlib import contextmanager, redirect_stdout
from importlib import import_module
from pathlib import Path

from calibration.estimation.false_alarms import ALPHA
from msg_tools import NAMESPACE
from pointing_model.mount_kinds import kinds_text

from ..nights.night_files import log_of, model_of

#: types for ``add_argument``: a log or run, and a model; a night's folder can stand for either
log_path, model_path = log_of, model_of
#: kinds of mounts, for all commands
MOUNT_KINDS = f'{kinds_text()} (where the first axis points, degrees)'
#: runs that commands read
RUNS = 'file of pointings of any kind in docs/your_own_file.md, or a log'
#: suffixes of models and pages
MODELS, PAGES = ('.json', '.yaml', '.yml'), ('.html', '.htm')
#: names from registries, which are slow to import: plate solvers, and files of orbits
SOLVERS, ORBITS = 'solve-field, astap', 'CPF, OMM, two-line elements, OEM, SP3'


class Default(str):
    """A number given by its name in the module that uses it, loaded only when needed."""

    @property
    def value(self):
        """The number."""
        module, _, name = self.rpartition('.')
        return getattr(import_module(module), name)

    def __str__(self):
        return f'{self.value:g}'


def _within(kind, low, high, words):
    def parse(text):
        try:
            value = kind(text.value if isinstance(text, Default) else text)
        except ValueError:
            value = float('nan')
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f'{text!r}: must be {words}')
        return value
    return parse


def whole(low, high):
    """A type for ``add_argument``: a whole number from `low` to `high`."""
    return _within(int, low, high, f'a whole number, {low} to {high}')


def real(low, high, unit=''):
    """A type for ``add_argument``: a number from `low` to `high`, in `unit`."""
    return _within(float, low, high, f'a decimal number, {low:g} to {high:g} {unit}'.rstrip())


def _with_reason(parse):
    """A type for ``add_argument`` that reports why `parse` refuses a text."""
    def parsed(text):
        try:
            return parse(text)
        except (ValueError, OSError) as error:
            raise argparse.ArgumentTypeError(str(error)) from None
    return parsed


@_with_reason
def utc(text):
    """A type for ``add_argument``: an ISO 8601 date."""
    if text:
        from msg_tools.iso_time import iso_seconds
        iso_seconds(text)
    return text


@_with_reason
def horizon(text):
    """A type for ``add_argument``: corners of a skyline, or a file of them."""
    from pointing_model.sky.skyline import parse_horizon
    return parse_horizon(text)


@_with_reason
def gap_hours(text):
    """A type for ``add_argument``: hours of a gap; none: 0; auto: None."""
    try:
        return {'none': 0.0, 'auto': None}[text] if text in ('none', 'auto') else float(text)
    except ValueError:
        raise ValueError(f'{text!r}: write a number of hours, auto or none') from None


def zero(text):
    """A type for ``add_argument``: newest, none, or the number of a run."""
    if text not in ('newest', 'none') and not text.lstrip('-').isdigit():
        raise argparse.ArgumentTypeError(f'{text!r}: write newest, none or the number of a run')
    return text


def names(text):
    """The names in a comma-separated list."""
    return tuple(name.strip() for name in text.split(',') if name.strip())


#: shared options, as arguments of ``add_argument``
SHARED = {
    'seed': {'type': whole(0, 2**31 - 1), 'default': 1,
             'help': 'of every random number (default: 1)'},
    'polaris': {'type': whole(2, 5000),
                'default': Default('telescope_mount.observing.plan.ZERO_EXPOSURES'),
                'help': 'exposures for a zero: of Polaris where it is well up, else of a few '
                'stars (default: %(default)s)'},
    'date': {'default': '', 'type': utc, 'metavar': 'UTC',
             'help': 'begin of the night, ISO 8601 (default: 2026-01-15T13:00:00)'},
    'latitude': {'type': real(-90.0, 90.0, 'degrees'), 'metavar': 'DEG', 'help': 'of the site, '
                 'north positive; right ascensions and equatorial mounts need it'},
    'longitude': {'type': real(-180.0, 360.0, 'degrees'), 'metavar': 'DEG',
                  'help': 'of the site, east positive'},
    'height': {'type': real(-500.0, 10000.0, 'm'), 'metavar': 'M',
               'help': 'of the site above the ellipsoid (default: as the file or '
               'scenario says, else sea level)'},
    'reference': {'type': model_path, 'metavar': 'MODEL'},
    'encoder': {'choices': ('enc', 'abs'), 'default': 'enc',
                'help': 'which pair of encoder columns (default: enc)'},
    'azimuth-origin': {'choices': ('N', 'S'), 'help': 'where azimuth 0 is; '
                       'both count through east (90 deg), as TPOINT does (default: as the file '
                       'says, else N)'},
    'exclude': {'action': 'append', 'default': [], 'metavar': 'ROWS',
                'help': 'rows to leave out: numbers as they are printed (30), ranges (45-48), '
                'conditions (el<20, star=HIP 5447), with commas or again'},
    'mount': {'metavar': 'KIND', 'help': f'{MOUNT_KINDS}, instead of that of the file'},
    'pressure': {'type': real(0.0, 1200.0, 'hPa'), 'metavar': 'HPA',
                 'help': 'of the air, for runs in right ascension; 0: no refraction (default: as '
                 'the file says, else a standard atmosphere at the height)'},
    'temperature': {'type': real(-90.0, 60.0, 'degrees Celsius'), 'metavar': 'C',
                    'help': 'of the air, for runs in right ascension (default: as the file says, '
                    'else 10)'},
    'equinox': {'choices': ('auto', 'j2000', 'date'), 'default': 'auto',
                'help': 'of right ascensions in the file: J2000, or apparent places of date; auto '
                '(default): that of the file, else what fits'},
    'harmonics': {'choices': ('none', 'zenith', 'printed'), 'default': 'none',
                  'help': "paper 000's spherical harmonics in the model, by how their E is read: "
                  'zenith distance, or as printed (default: none)'},
    'harmonics-alone': {'action': 'store_true', 'help': 'harmonics without the physical terms, '
                        'as in the paper; default: fitted to what the terms leave'},
    'harmonics-degree': {'type': whole(0, 4), 'default': 0, 'metavar': 'N', 'help': 'degree '
                         'of the harmonics; 0 (default): chosen by cross-validation'},
    'jobs': {'type': whole(1, 1024), 'metavar': 'N', 'help': 'processes for '
             'the cross-validation; the result is the same (default: one per processor)'},
    'alpha': {'type': real(1e-6, 0.5), 'default': ALPHA,
              'help': f'chance of any false alarm in a run with nothing wrong (default: {ALPHA})'},
    'orbit': {'action': 'append', 'default': [], 'type': Path, 'metavar': 'FILE', 'required': True,
              'help': f'{ORBITS}; also .gz or .Z; may be given again: files of one satellite are '
              'joined'},
    'sessions': {'type': gap_hours, 'metavar': 'HOURS'},
    'namespace': {'default': NAMESPACE, 'help': f'of the graph (default: {NAMESPACE})'},
    'params': {'type': Path, 'metavar': 'FILE'},
    'domain': {'type': whole(0, 101), 'metavar': 'N', 'help': 'ROS domain (default: a free one)'},
}


#: how files of runs are read
OF_RUNS = ('azimuth-origin', 'mount', 'latitude', 'longitude', 'height', 'pressure', 'temperature',
           'equinox')
MOUNT_OF_DRIVERS = f'{MOUNT_KINDS} (default: altaz)'
RUNNING_DOMAIN = 'ROS domain (default: ROS_DOMAIN_ID, or 0)'
MOUNT_OF_NIGHT = f'kind of the mount: {MOUNT_KINDS}; default: that of the scenario'


def add(parser, *names, **changes):
    """Add options of `SHARED` by name, with `changes` for this command."""
    for name in names:
        parser.add_argument(f'--{name}', **SHARED[name] | changes)


def add_graph(parser):
    """Add --namespace and --domain of a running graph."""
    add(parser, 'namespace')
    add(parser, 'domain', help=RUNNING_DOMAIN)


def add_out(parser, default, what):
    """Add --out: a folder for results."""
    parser.add_argument('--out', type=Path, default=Path(default), metavar='DIR',
                        help=f'folder for {what} (default: {default})')


def refuse(args, reason, **usual):
    """Refuse options that differ from their `usual` values, as they would do nothing."""
    for name, value in usual.items():
        if getattr(args, name) != value:
            raise ValueError(f'--{name.replace("_", "-")} {reason}')


def harmonics_of(args):
    """Parameters of the calibration from the options of harmonics.

    Raises
    ------
    ValueError
        A degree, or --harmonics-alone, without harmonics.
    """
    if args.harmonics == 'none' and not args.harmonics_alone and not args.harmonics_degree:
        return {}
    from calibration.analysis.harmonic_fit import choice_of
    given = {'harmonics': args.harmonics, 'harmonics_alone': args.harmonics_alone,
             'harmonics_degree': args.harmonics_degree}
    choice_of(given)
    return given


def mount_of(args):
    """The mount given by --mount and --latitude, or None."""
    if args.mount is None:
        return None
    from msg_tools.units import DEG
    from pointing_model.mounts import parse_mount
    return parse_mount(args.mount, None if args.latitude is None else args.latitude * DEG)


def check_mount(args, path, mount):
    """Refuse --mount and --latitude that contradict the mount of our own model."""
    from math import degrees

    from pointing_model.mounts import parse_mount
    from pointing_model.sky.site import SITE
    other = args.mount and parse_mount(args.mount, mount.latitude).kind != mount.kind
    if other or mount.celestial and args.latitude is not None and abs(
            args.latitude - degrees(mount.latitude)) > SITE['latitude_deg'].same:
        latitude = f', latitude {degrees(mount.latitude):.4f} deg' if mount.celestial else ''
        raise ValueError(f'{path} is a model of {mount.names.words}{latitude}: leave out '
                         '--mount, --latitude and comments of the table that name another')


def given_site(args):
    """Fields of `Site` given by options, SI."""
    from pointing_model.sky.site import SITE
    return {one.field: float(getattr(args, one.field)) * one.size for one in SITE.values()
            if getattr(args, one.field) is not None}


def given_air(args):
    """Fields of `Weather` given by options."""
    return {name: float(value) for name, value in (
        ('pressure_hpa', args.pressure), ('temperature_c', args.temperature)) if value is not None}


def place_of(args):
    """Arguments for reading a run: origin of azimuth, site, weather, mount, equinox, if given.

    Site and weather may be partial: the file gives the rest, see `read_run`.
    """
    from pointing_model.sky.refraction import Weather
    from pointing_model.sky.site import Site
    site, weather = given_site(args), given_air(args)
    Site(**site)  # raises if out of range
    Weather(**weather)
    return _given(azimuth_origin=args.azimuth_origin, mount=args.mount, site=site or None,
                  weather=weather or None,
                  equinox=None if args.equinox == 'auto' else args.equinox)


def _given(**values):
    """The values that are not None."""
    return {name: value for name, value in values.items() if value is not None}


def sky_of(args):
    """Parameters of the sky from latitude, longitude and height."""
    return _given(latitude_deg=args.latitude, longitude_deg=args.longitude,
                  height_m=getattr(args, 'height', None))


def check_params(path):
    """Refuse an invalid ROS parameter file before the graph is started.

    Raises
    ------
    ValueError
        It does not exist, or is not a parameter file.
    """
    if path is None:
        return
    if not path.is_file():
        raise ValueError(f'{path} is no file; give a ROS parameter file with --params')
    from ..input_files.parameter_file import sections
    sections(path)


def check_target(path, suffixes=()):
    """Refuse an output file that cannot be written before starting the work.

    Parameters
    ----------
    path : Path or None
    suffixes : sequence of str
        Allowed endings of its name; empty: any.

    Raises
    ------
    ValueError
        Its name has another ending, it is a folder, or its folder does not exist.
    """
    if not isinstance(path, Path):
        return
    if suffixes and path.suffix.lower() not in suffixes:
        raise ValueError(f'{path}: the name must end in {" or ".join(suffixes)}')
    folder = path.absolute().parent
    wrong = ('it is a folder; name a file' if path.is_dir() else
             'there is no such folder; make it, or name another' if not folder.is_dir() else
             'it may only be read; name another file' if path.exists() and not os.access(
                 path, os.W_OK) else
             # a file is written to its folder first, then renamed
             'the folder may only be read; name another' if (not path.exists() or path.is_file())
             and not os.access(os.path.dirname(os.path.realpath(path)), os.W_OK) else '')
    if wrong:
        raise ValueError(f'{path} cannot be written: {wrong}')


class _JsonTarget:
    """Standard output as the target of --json; other output is suppressed."""

    def __init__(self, stream):
        self._stream = stream

    def write_text(self, text):
        from .console import step_aside
        step_aside(for_good=True)
        self._stream.write(text)
        self._stream.flush()

    def __str__(self):
        return 'the standard output'


def add_json(parser, what='the result'):
    """Add --overwrite and --json: the same in all commands, see `json_given`."""
    add_overwrite(parser)
    parser.add_argument('--json', type=_json_target, nargs='?', const='-', metavar='FILE.json',
                        help=f'print {what} as JSON, and nothing else; with FILE.json write it '
                        'there, beside what is printed')


def _json_target(text):
    return text if text == '-' else Path(text)


def json_given(argv):
    """Let --json take the next word only if that is the name of a JSON file.

    Parameters
    ----------
    argv : list of str

    Returns
    -------
    list of str
    """
    out = []
    for word, after in zip(argv, [*argv[1:], '']):
        alone = word == '--json' and after != '-' and not after.lower().endswith('.json')
        out.append('--json=-' if alone else word)
    return out


@contextmanager
def json_alone(args):
    """Suppress all other output while --json prints."""
    if getattr(args, 'json', None) != '-':
        yield
        return
    args.json = _JsonTarget(sys.stdout)
    with open(os.devnull, 'w', encoding='utf-8') as nobody, redirect_stdout(nobody):
        yield


def add_overwrite(parser):
    """Add --overwrite."""
    parser.add_argument('--overwrite', action='store_true',
                        help='write files that are named although they are there already')


def check_files(args):
    """Refuse invalid output files and --params before starting the work.

    Raises
    ------
    ValueError
        See `refuse_existing`, `check_target`, `check_params`.
    """
    for name in ('save', 'json', 'report', *getattr(args, 'written', ())):
        path = getattr(args, name, None)
        refuse_existing(path, args)
        check_target(path, {'save': MODELS, 'report': PAGES}.get(name, ()))
    check_params(getattr(args, 'params', None))


def refuse_existing(path, args):
    """Refuse an existing file unless --overwrite is given.

    Raises
    ------
    ValueError
        The file exists.
    """
    if isinstance(path, Path) and not args.overwrite and path.is_file() and (
            path.absolute().parts[1:2] != ('dev',)):
        raise ValueError(f'{path} is there already; name another file, or give --overwrite')


def is_list(args):
    """Whether only the names of scenarios are requested."""
    return getattr(args, 'scenario', None) == 'list'


def add_scenario(parser, **given):
    """Add --scenario, with completion in shells."""
    parser.add_argument('--scenario', metavar='NAME', **given).completer = _scenarios


def _scenarios(**_):
    from ..simulation import scenario_names
    return ['list', *scenario_names()]


def list_scenarios(args, *patterns):
    """Print names and descriptions of scenarios; only those that match a pattern, if given.

    Returns
    -------
    None
    """
    from fnmatch import fnmatchcase

    from ..simulation import described_scenarios
    from .console import new_console, write_outputs
    scenarios = {name: text for name, text in described_scenarios().items()
            if not patterns or any(fnmatchcase(name, pattern) for pattern in patterns)}
    from calibration.report.terminal_tables import new_table
    console = new_console()
    table = new_table('', 'scenario', 'what it does')
    table.columns[1].justify = 'left'
    for row in scenarios.items():
        table.add_row(*row)
    console.print(table)
    write_outputs(console, args, scenarios, 'names')


def add_verbose(parser, what):
    """Add --verbose, for more than the first lines."""
    parser.add_argument('--verbose', action='store_true', help=f'print all {what}')


def add_outputs(parser, json='the result', save='the model', report=True):
    """Add --report, --json, --save and --overwrite, for `console.write_outputs`."""
    if report:
        parser.add_argument('--report', type=Path, metavar='FILE', help='write the page (.html)')
    if save:
        parser.add_argument('--save', type=Path, metavar='FILE',
                            help=f'write {save} (.json, .yaml)')
    add_json(parser, json)
