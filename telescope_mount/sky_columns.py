"""Right ascensions and declinations of a table, as the angles of a perfect mount at their times."""

import numpy as np

from msg_tools.units import DEG
from pointing_model.runs.plate_solves.frames import ICRS, OF_DATE, to_icrs
from pointing_model.sky.places import DEFAULT_WEATHER, Site, Weather, observed_directions

#: columns of such a table
SKY = ('ra_deg', 'dec_deg')
#: words of a side of the pier -> through the pole
_SIDES = {'east': False, 'e': False, 'west': True, 'w': True}


def is_sky(cells, places):
    """Whether a table gives places of the sky, and not those of the axes."""
    return set(SKY) <= set(cells) and places[0] not in cells


def check_sky(table, ra, dec, cells):
    """Refuse what is no right ascension and declination in degrees."""
    with np.errstate(invalid='ignore'):
        for name, bad in zip(SKY, ((ra < 0.0) | (ra > 360.0), np.abs(dec) > 90.0)):
            table.refuse(name, cells[name], {
                int(i): 'is no such angle in degrees' for i in np.flatnonzero(bad)})


def observed(model, ra, dec, columns, cells, used, args):
    """The angles that a perfect mount of this kind reads there.

    Parameters
    ----------
    model : PointingModel
    ra, dec : ndarray, shape (n,)
        Degrees: ICRS, or apparent places of date with ``args.equinox``.
    columns : dict of str to ndarray
        Drivers in SI: ``time``, and the air where it is given.
    cells : dict
        Of the table, for ``pier_side``.
    used : ndarray of bool, shape (n,)
        Rows that are not left out.
    args : argparse.Namespace
        Of the command: site, air, equinox.

    Returns
    -------
    first, second : ndarray, shape (n,)
        Degrees, on the side of the pier that the table gives, else with the counterweight down.
    height : ndarray, shape (n,)
        Above the horizon, degrees.

    Raises
    ------
    ValueError
        No time or site, or another latitude than the mount's.
    """
    mount = model.mount
    if 'time' not in columns:
        raise ValueError('ra_deg, dec_deg need the time: a column time, or --time UTC')
    latitude = args.latitude
    if mount.celestial:
        own = mount.latitude / DEG
        if latitude is not None and abs(latitude - own) > 0.01:
            raise ValueError(f'--latitude {latitude:g} is not that of the model ({own:.4f})')
        latitude = own if latitude is None else latitude
    if latitude is None or args.longitude is None:
        raise ValueError('ra_deg, dec_deg need the site: --latitude and --longitude')
    time = columns['time']
    if not np.isfinite(time[used]).all():
        raise ValueError('ra_deg, dec_deg need the time of every row')
    time = np.where(used, time, time[used][0] if used.any() else 0.0)
    frame = OF_DATE if args.equinox == 'date' else ICRS
    icrs = to_icrs(ra * DEG, dec * DEG, frame, time)
    weather = Weather(*(_air(columns, name, given, usual) for name, given, usual in (
        ('pressure', args.pressure, DEFAULT_WEATHER.pressure_hpa),
        ('temperature', args.temperature, DEFAULT_WEATHER.temperature_c))))
    seen = observed_directions(*icrs, time, Site(latitude * DEG, args.longitude * DEG,
                                                 args.height or 0.0), weather)
    first, second = mount.axes_of(seen.az, seen.el)
    beyond = mount.side_for(first, second, 0.0, False)
    if mount.two_sided and 'pier_side' in cells:
        words = [str(cell).strip().lower().removeprefix('pier').lstrip(' _')
                 for cell in cells['pier_side']]
        beyond = np.array([_SIDES.get(word, down) for word, down in zip(words, beyond)])
    first, second = mount.on_travel(*mount.axes_of(seen.az, seen.el, beyond))
    if mount.vertical:
        first = np.mod(first, 2.0 * np.pi)
    return first / DEG, second / DEG, seen.el / DEG


def _air(columns, name, given, usual):
    usual = usual if given is None else given
    if name not in columns:
        return usual
    return np.where(np.isfinite(columns[name]), columns[name], usual)
