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

"""The command ``passes``: when satellites can be tracked."""

from datetime import datetime, timezone

from . import options

#: most passes listed without --verbose
_MOST = 15


def add(commands):
    """Add the parser."""
    parser = commands.add_parser(
        'passes', help='when satellites can be tracked, and what a keyhole costs',
        description='List the passes of satellites over a site: time, height, phase, the Sun, and '
        'the seconds that are lost where an axis is too slow.')
    options.add(parser, 'orbit')
    parser.add_argument('--object', metavar='ID', help='one satellite (default: all of the files)')
    options.add(parser, 'latitude', 'longitude', 'height', 'mount')
    options.add(parser, 'date', help='from when on, ISO 8601 (default: the begin of the orbit; of '
                'elements their epoch)')
    parser.add_argument('--hours', type=options.real(0.01, 1000.0, 'hours'), default=24.0,
                        metavar='H', help='how long (default: 24)')
    parser.add_argument('--lowest', type=options.real(0.0, 89.0, 'degrees'), default=20.0,
                        metavar='DEG', help='least elevation (default: 20)')
    parser.add_argument('--rate', type=options.real(0.01, 100.0, 'deg/s'), default=4.0,
                        metavar='DEG_S', help='of either axis, deg/s (default: 4)')
    parser.add_argument('--acceleration', type=options.real(0.01, 100.0, 'deg/s^2'), default=2.0,
                        metavar='DEG_S2', help='of either axis, deg/s^2 (default: 2)')
    parser.add_argument('--day-too', action='store_true', help='also by day and in the shadow of '
                        'the Earth (lasers, radio)')
    options.add_verbose(parser, 'passes, with phase, Sun and rates')
    options.add_json(parser)


def run(args):
    """Read, search, print."""
    import numpy as np

    from calibration.analysis.satellites.track_faults import elements_age
    from calibration.report.wording import wording
    from msg_tools.iso_time import iso_seconds
    from msg_tools.units import DEG
    from pointing_model.mounts import parse_mount
    from pointing_model.sky.orbits.orbit_files import Orbits
    from pointing_model.sky.site import Site

    from ..guard.limits import Axis
    from ..observing.pass_forecast import pass_forecasts
    from .console import new_console, print_lines, write_outputs
    if args.latitude is None or args.longitude is None:
        raise ValueError('no site: give --latitude and --longitude')
    site = Site(args.latitude * DEG, args.longitude * DEG, args.height or 0.0)
    mount = parse_mount(args.mount or 'altaz', site.latitude)
    axes = [Axis(-9.0, 9.0, args.rate * DEG, args.acceleration * DEG)] * 2
    orbits, found, ages, spans = Orbits(args.orbit), [], [], {}
    covered = False
    for name in [args.object] if args.object else orbits.names:
        orbit = orbits.orbit(name)
        start = iso_seconds(args.date) if args.date else max(
            orbit.begin, getattr(orbit, 'epoch', orbit.begin))
        end = start + 3600.0 * args.hours
        if orbit.precise and not orbit.begin <= start < end <= orbit.end:
            spans.setdefault((orbit.begin, orbit.end, start, end), []).append(orbit.name)
        covered |= orbit.begin < end and start < orbit.end
        if not orbit.precise:
            ages.append(elements_age(orbit, np.array([start, end])))
        found += pass_forecasts(orbit, start, args.hours, site, mount=mount, axes=axes,
                                low=args.lowest * DEG, dark=not args.day_too)
    short = [f'{", ".join(names)}: orbit data from {_hours(first, last)}, asked for '
             f'{_hours(start, end)}' for (first, last, start, end), names in spans.items()]
    if not covered:
        raise ValueError(f'{short[0]}: no overlap; give the file of that day, or another --date')
    found.sort(key=lambda one: one.start)
    console = new_console()
    console.print(_table(found, mount, args.verbose))
    if not args.verbose and len(found) > _MOST:
        console.print(f'{len(found) - _MOST} more passes; --verbose lists all, with Sun and rates')
    if not found:
        console.print('no pass in these hours' if args.day_too else
                      'no sunlit pass at night in these hours; --day-too lists all')
    print_lines(console, 'note', [*orbits.notes, *short, *map(wording, ages)])
    write_outputs(console, args, [one.document() for one in found], 'passes')


def _hours(first, last):
    return ' to '.join(f'{datetime.fromtimestamp(one, timezone.utc):%Y-%m-%d %H:%M} UTC'
                       for one in (first, last))


def _table(found, mount, verbose):

    from calibration.report.terminal_tables import new_table
    from msg_tools.units import ARCSEC, DEG
    more = ('phase', 'in the Sun', 'from the Sun', 'arcsec/s') if verbose else ()
    out = new_table(f'{len(found)} passes', 'satellite', 'UTC', 'min', 'highest', *more, 'keyhole')
    for one in found if verbose else found[:_MOST]:
        begin = datetime.fromtimestamp(one.start, timezone.utc)
        lost = ', '.join(f'{hole.lost:.0f} s of the {mount.names.axes[hole.axis]} '
                         f'({hole.wanted / DEG:.0f} deg/s)' for hole in one.keyholes)
        details = (f'{one.phase / DEG:.0f}°', f'{100.0 * one.sunlit:.0f} %',
                   f'{one.sun_distance / DEG:.0f}°', f'{one.fastest / ARCSEC:.0f}')
        out.add_row(one.name, f'{begin:%Y-%m-%d %H:%M:%S}', f'{(one.end - one.start) / 60.0:.1f}',
                    f'{one.top_el / DEG:.0f}°', *details[:len(more)], lost or '–')
    return out
