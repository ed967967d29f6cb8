"""Kinds of options, and options that several commands have."""

import argparse
from pathlib import Path


def _within(kind, low, high, words):
    def parse(text):
        try:
            value = kind(text)
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
    return _within(float, low, high, f'{low:g} to {high:g} {unit}')


def names(text):
    """The names in a comma-separated list."""
    return tuple(name.strip() for name in text.split(',') if name.strip())


#: options that several commands have, as ``add_argument`` takes them
SHARED = {
    'seed': {'type': whole(0, 2**31 - 1), 'default': 1,
             'help': 'of every random number (default: 1)'},
    'polaris': {'type': whole(2, 5000), 'default': 16,
                'help': 'exposures for a zero: of Polaris where it is well up, else of a few '
                'stars (default: 16)'},
    'date': {'default': '', 'metavar': 'UTC',
             'help': 'begin of the night, ISO 8601 (default: 2026-01-15T13:00:00)'},
    'latitude': {'type': real(-90.0, 90.0, 'degrees'), 'metavar': 'DEG', 'help': 'of the site'},
    'longitude': {'type': real(-180.0, 360.0, 'degrees'), 'metavar': 'DEG',
                  'help': 'of the site, east positive'},
    'height': {'type': real(-500.0, 9000.0, 'm'), 'metavar': 'M',
               'help': 'of the site above the ellipsoid'},
    'reference': {'type': Path, 'metavar': 'MODEL'},
    'encoder': {'choices': ('enc', 'abs'), 'default': 'enc',
                'help': 'which pair of encoder columns (default: enc)'},
    'azimuth-origin': {'choices': ('N', 'S'), 'help': 'where azimuth 0 is in a TPOINT file'},
    'mount': {'metavar': 'KIND', 'help': 'altaz, equatorial, german, or free:AZ,EL[,ROLL] (where '
              'the first axis points, degrees), in place of what the file tells'},
    'pressure': {'type': real(0.0, 1200.0, 'hPa'), 'metavar': 'HPA',
                 'help': 'for runs in right ascension; 0: no refraction'},
    'temperature': {'type': real(-90.0, 60.0, 'degrees Celsius'), 'metavar': 'C',
                    'help': 'for runs in right ascension'},
    'harmonics': {'choices': ('none', 'zenith', 'printed'), 'default': 'none',
                  'help': "paper 000's spherical harmonics in the model, by how their E is read: "
                  'zenith distance, or as printed (default: none)'},
    'harmonics-alone': {'action': 'store_true', 'help': 'without the physical terms, as in the '
                        'paper; else of what the terms leave'},
    'harmonics-degree': {'type': whole(0, 4), 'default': 0, 'metavar': 'N', 'help': 'where the '
                         'series ends; 0 (default): what predicts stars left out best'},
    'domain': {'type': whole(0, 101), 'metavar': 'N', 'help': 'ROS domain (default: a free one)'},
}


MOUNT_OF_NIGHT = ('what the observer is told of the mount: altaz, equatorial, german, or '
                  'free:AZ,EL[,ROLL] (where the first axis points, degrees); default: the kind '
                  'that the scenario has')
SERVER_OF_NIGHT = ('; or indi:HOST[:PORT[:KIND]] or alpaca:HOST[:PORT[:KIND]]: a mount of an INDI '
                   'or Alpaca server in place of the simulated one, on the clock of this machine')


def add_server(parser):
    """Add the options of a night on a mount of a server."""
    parser.add_argument('--camera', default='', metavar='indi:HOST:PORT:NAME',
                        help='of a mount of a server: the camera of an INDI server whose images '
                        'are solved; by default a simulator tells where it looks')
    parser.add_argument('--driver', type=Path, action='append', default=[], metavar='FILE',
                        help='the same: the driver in Python of a camera of your own')
    parser.add_argument('--exposure', type=real(1e-3, 600.0, 's'), default=1.0, metavar='S',
                        help='the same: length of its exposures, in which the mount must rest on '
                        'its track (default: 1)')
    parser.add_argument('--anew', action='store_true', help='the same: begin a night that was '
                        'interrupted in --out once more; by default it goes on where it stopped')


def add(parser, *names, **changes):
    """Add options of `SHARED` by name, with `changes` of this command."""
    for name in names:
        parser.add_argument(f'--{name}', **SHARED[name] | changes)


def add_out(parser, default, what):
    """Add --out: a folder for results."""
    parser.add_argument('--out', type=Path, default=Path(default), metavar='DIR',
                        help=f'folder for {what} (default: {default})')


def harmonics_of(args):
    """The parameters of the calibration that the options of harmonics set.

    Raises
    ------
    ValueError
        A degree, or alone, without harmonics.
    """
    if args.harmonics == 'none' and not args.harmonics_alone and not args.harmonics_degree:
        return {}
    from calibration.harmonic_fit import choice_of
    given = {'harmonics': args.harmonics, 'harmonics_alone': args.harmonics_alone,
             'harmonics_degree': args.harmonics_degree}
    choice_of(given)
    return given


def mount_of(args):
    """The mount that --mount and --latitude say, or None."""
    if args.mount is None:
        return None
    from msg_tools.units import DEG
    from pointing_model.mounts import parse_mount
    return parse_mount(args.mount, None if args.latitude is None else args.latitude * DEG)


def place_of(args):
    """Site, weather and mount for reading a run, where options give them.

    Of a site what is given: the rest is what the file tells, see `read_run`.
    """
    from dataclasses import replace

    from msg_tools.units import DEG
    from pointing_model.sky import DEFAULT_WEATHER, Site
    out = {}
    if args.mount is not None:
        out['mount'] = args.mount
    site = {name: value * unit for name, value, unit in (
        ('latitude', args.latitude, DEG), ('longitude', args.longitude, DEG),
        ('height', args.height, 1.0)) if value is not None}
    if site:
        out['site'] = Site(**{'height': 0.0, **site}) if len(site) == 3 else site
    given = {name: value for name, value in (('pressure_hpa', args.pressure),
                                             ('temperature_c', args.temperature))
             if value is not None}
    if given:
        out['weather'] = replace(DEFAULT_WEATHER, **given)
    return out


def sky_of(args):
    """The parameters of the sky that latitude, longitude and height set."""
    given = {'latitude_deg': args.latitude, 'longitude_deg': args.longitude,
             'height_m': getattr(args, 'height', None)}
    return {name: value for name, value in given.items() if value is not None}


def check_target(path, suffixes=()):
    """Refuse a file that could not be written, before the work and not after it.

    Parameters
    ----------
    path : Path or None
    suffixes : sequence of str
        One of which its name must have, if there are any.

    Raises
    ------
    ValueError
        Its name ends otherwise, it is a folder, or there is none for it.
    """
    if path is None:
        return
    if suffixes and path.suffix.lower() not in suffixes:
        raise ValueError(f'{path}: the name must end in {" or ".join(suffixes)}')
    if path.is_dir() or not path.absolute().parent.is_dir():
        raise ValueError(f'{path} cannot be written: '
                         + ('it is a folder' if path.is_dir() else 'there is no such folder'))


def write_json(path, document):
    """Write a result, as --json of all commands does."""
    import json
    path.write_text(json.dumps(document, indent=1) + '\n', encoding='utf-8')
