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

"""Catalogue places and readings as angles of the mount's axes, from the columns of a file."""

from dataclasses import replace

import numpy as np

from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.mounts import is_beyond, sides, through_pole
from pointing_model.runs.run import REQUIRED, known_site

from . import equinox
from .pier_side import note_counterweight, read_beyond, through_the_pole
from .row_checks import PAIRS
from .solve_columns import refuse_hours

#: readings of an alt-azimuth mount are within this of their places (azimuth: without its zero)
_NEAR = 10.0 * DEG
#: fewer than `_FEWEST` rows below this elevation with azimuth half a turn off have a wrong azimuth:
#: they are not beyond the zenith
_LOW, _FEWEST = 60.0 * DEG, 3
_LEAST = 0.05  # arcsec: the atmosphere alone causes larger errors
_MOST = 0.9  # fraction of rows near their places, needed to take any as beyond the zenith


def observe_places(path, table, weather, origin, mount):
    """Observed `az`, `el` of the rows from `ra`, `dec`, `time`, in the file's sense of azimuth.

    They are azimuth and elevation for every kind of mount; `to_axes` converts them. If the file has
    sidereal times (``lst_given``, radians), these give the moment and ``time`` only the day.

    Raises
    ------
    ValueError
        The site is missing, a time is not UTC, or weather is out of range.
    """
    columns, meta = table.columns, table.meta
    if 'ra_deg' not in columns:
        return
    given_longitude = 'longitude' in known_site(meta)
    site = _whole_site(path, meta, meta.get('sidereal_clock'))
    if not meta.get('time_is_utc', True):
        raise ValueError(f'{path}: ra_deg, dec_deg need time in UTC: ISO 8601, or seconds since '
                         '1970-01-01')
    from pointing_model.runs.plate_solves.frames import ICRS, Solved, to_icrs
    from pointing_model.sky.places import icrs_to_observed, moment_of
    declared, from_images = meta.pop('sky_frame', None), bool(
        meta.get('solver_sigma') or meta.get('from_images'))
    frame, by_fit = declared or ICRS, 'equinox' in meta
    ra, dec, time = (columns.pop('ra_deg'), columns.pop('dec_deg'), columns['time'])
    if 'lst_given' in columns:
        columns['lst_h'] = columns.pop('lst_given') * (12.0 / np.pi)
        known = np.isfinite(columns['lst_h'] + time)
        time = np.where(known, 0.0, np.nan)
        time[known] = moment_of(columns['lst_h'][known] * (np.pi / 12.0),
                                columns['time'][known], site)
        columns['time'] = time
        _note_clock(meta, site if given_longitude else None)
        if not given_longitude:  # the times give only the day and the order of the rows
            meta['time_is_utc'] = False
    table.exclude(np.abs(dec) > np.pi / 2, 'dec_deg is beyond 90')
    ok = (table.reasons == 0) & np.isfinite(ra) & np.isfinite(dec) & np.isfinite(time)
    az, el = np.full((2, len(ra)), np.nan)
    if ok.any():
        try:
            air = _air(columns, ok, site, weather, meta)
            icrs = to_icrs(ra[ok], dec[ok], frame, time[ok])
            refuse_hours(path, *icrs, time[ok], site)
            az[ok], el[ok] = icrs_to_observed(*icrs, time[ok], site, air)
            if not by_fit:
                meta['solved'] = Solved(table.lines[ok], ra[ok], dec[ok], time[ok], frame,
                                        declared is not None, site, air, from_images)
            if by_fit and declared is None:
                az[ok], el[ok] = equinox.which_fits(
                    table, ok, (az[ok], el[ok]), (ra[ok], dec[ok], time[ok], site, air), mount)
            elif by_fit and 'equinox_given' in meta:
                equinox.refuse_contradicted(path, table, ok, (az[ok], el[ok]),
                                            (ra[ok], dec[ok], time[ok], site, air), mount)
        except ValueError as error:
            text = str(error)
            raise ValueError(text if text.startswith(str(path)) else f'{path}: {text}') from None
    meta.pop('equinox', None)
    columns['az'], columns['el'] = (np.pi - az if origin == 'S' else az), el
    meta['from_horizon'] = True
    if by_fit:
        if declared is not None:
            meta['notes'].append(f'places of the catalogue read as {declared.text}, as '
                                 'requested')
        return
    angles = 'az, el' if mount.vertical else f'{" and ".join(mount.names.axes)} of the catalogue'
    meta['notes'].append(f'{angles} are observed places of ra_deg, dec_deg ({frame.text}, no '
                         'proper motion)'
                         + ('' if declared else '; no comment "# frame: ..." says so'))


def mount_ascension(path, table):
    """Hour angle readings of the mount from its right ascension and the sidereal time.

    Raises
    ------
    ValueError
        There is no sidereal time, and no longitude or UTC to compute it from; a frame is declared
        for readings that are not right ascensions, or it needs UTC and there is none.
    """
    columns, meta = table.columns, table.meta
    frame = meta.pop('readings_frame', None)
    if 'ra_enc_deg' not in columns:
        if frame is not None:
            raise ValueError(f'{path}: readings {frame.text} needs a column ra_enc_deg, and there '
                             'is none')
        return
    ascension = columns.pop('ra_enc_deg')
    if 'az_enc' in columns:
        meta['notes'].append(f'ra_enc_deg left out: {table.label("az_enc")} is taken')
        return
    if 'lst_h' in columns:
        lst, text = columns['lst_h'] * (np.pi / 12.0), 'lst_h'
    else:
        if not meta.get('time_is_utc', True):
            raise ValueError(f'{path}: ra_enc_deg needs time in UTC, or a column lst_h')
        from pointing_model.sky.places import sidereal_time
        site, time = _whole_site(path, meta, False), columns['time']
        known = np.isfinite(time)
        lst = np.full(len(time), np.nan)
        lst[known] = sidereal_time(time[known], site)
        text = f'the time at longitude {site.longitude / DEG:.6g} deg'
        meta['reads_by_clock'] = True  # a clock error shifts the mount's hour angle
    from pointing_model.runs.plate_solves.frames import OF_DATE, to_date
    if 'solved' in meta:  # keep the readings as the file has them
        rows = np.searchsorted(table.lines, meta['solved'].lines)
        meta['solved_readings'] = replace(
            meta['solved'], ra=ascension[rows], dec=columns['el_enc'][rows],
            frame=frame or OF_DATE, declared=frame is not None)
    if frame is not None:
        known = np.isfinite(columns['time']) & np.isfinite(ascension)
        ascension[known], columns['el_enc'][known] = to_date(
            ascension[known], columns['el_enc'][known], frame, columns['time'][known])
    columns['az_enc'] = wrap(lst - ascension)
    meta['notes'].append(f'{table.label("az_enc")} computed from ra_enc_deg, read as '
                         f'{"of date" if frame is None else frame.text}, and '
                         f'the sidereal time from {text}')


def _note_clock(meta, site):
    """Add a note on how sidereal times became UTC; `site` is None if the longitude is unknown."""
    given = meta.pop('time_note', None)
    if given is None:
        return
    meta['notes'].append(given + (
        f', at longitude {site.longitude / DEG:.6g} deg' if site is not None else
        ', at longitude 0 (set --longitude): intervals are right, UTC is wrong by hours and places '
        'by up to 1 arcsec'))


def _whole_site(path, meta, sidereal_clock):
    """The `Site`, with the latitude and, without a sidereal clock, the longitude.

    Raises
    ------
    ValueError
        One of them is missing.
    """
    given = known_site(meta)
    needed = ('latitude',) if sidereal_clock else ('latitude', 'longitude')
    missing = [name for name in needed if name not in given]
    if missing:
        raise ValueError(f'{path}: right ascensions need the site, and its '
                         f'{" and ".join(missing)} is missing: comments '
                         + ', '.join(f'"# {name}_deg: ..."' for name in missing)
                         + f', or {" ".join(f"--{name} DEG" for name in missing)}')
    from pointing_model.sky.site import Site
    # with a sidereal clock the longitude only sets the time of day
    return Site(given['latitude'], given.get('longitude', 0.0), given.get('height', 0.0))


def to_axes(path, table, mount):
    """Convert places and readings to angles of the mount's axes, each row on its pier side.

    The pier side comes from readings beyond the pole (`pier_side.read_beyond`). If there are none,
    it comes from the column ``pier_side`` (`pier_side.through_the_pole`), and the readings are
    then places on the sky. Without either, no row is through the pole.

    Raises
    ------
    ValueError
        See `pier_side.through_the_pole`.
    """
    columns, meta = table.columns, table.meta
    beyond = np.zeros(len(table.lines), bool)
    pairs = [pair for pair in PAIRS[1:] if set(pair) <= set(columns)]
    side, by_side = columns.pop('pier_side', None), None
    with np.errstate(invalid='ignore', over='ignore'):
        place = (mount.axes_of if meta.get('from_horizon') else sides)(
            columns['az'], columns['el'])
        read = read_beyond(mount, place, [columns[name] for name in pairs[0]],
                           table.reasons == 0) if pairs else beyond
        if side is not None and not read.any():
            by_side = through_the_pole(path, table, side, place[0])
        _keep_written(path, table, pairs, side if by_side is None else by_side, mount)
        if read.any():
            beyond = read
            if mount.two_sided:
                note_counterweight(table, read, place[0])
        elif by_side is not None:
            beyond = by_side
            for az, el in pairs:
                columns[az], columns[el] = through_pole(columns[az], columns[el], beyond)
            for name in ('az_raw', 'el_raw'):
                if name in columns:
                    meta['notes'].append(f'{table.label(name)} left out: its side is '
                                         'unknown')
                    del columns[name]
        turned = is_beyond(columns['el']) & (table.reasons == 0)
        if turned.any() and not meta.get('from_horizon'):
            meta['notes'].append(f'{table.label("el")} is beyond 90 in {int(turned.sum())} rows: '
                                 'taken as that of the mount through the pole')
            columns['az'], columns['el'] = through_pole(columns['az'], columns['el'], turned)
        if meta.pop('from_horizon', False):
            columns['az'], columns['el'] = mount.axes_of(columns['az'], columns['el'], beyond)
        else:
            columns['az'], columns['el'] = through_pole(columns['az'], columns['el'], beyond)
        sound = table.reasons == 0  # excluded rows keep the angles of the file
        first, second = mount.on_travel(columns['az'], columns['el'])
        columns['az'] = np.where(sound, np.where(beyond, first, wrap(columns['az'])), columns['az'])
        columns['el'] = np.where(sound & beyond, second, columns['el'])
        for name, place in ((name, place) for pair in pairs for name, place in zip(pair, PAIRS[0])):
            columns[name] = np.where(sound, columns[place] + wrap(columns[name] - columns[place]),
                                     columns[name])
    _turn_on_sky(columns, beyond)
    if beyond.any():
        meta['notes'].append(f'{int(beyond.sum())} of {len(beyond)} rows are through the pole, on '
                             'the other side of the pier' + (
                                 '' if mount.two_sided or not mount.celestial else
                                 ': is this a German mount? Then give --mount german'))


def past_zenith(table):
    """Convert rows of an alt-azimuth mount beyond its zenith to angles of its axes.

    See `rows_beyond_zenith`. Their places are then beyond the zenith too. ``table.written`` keeps
    the angles of the file.
    """
    columns, pairs = table.columns, [pair for pair in PAIRS[1:] if set(pair) <= set(table.columns)]
    if not pairs:
        return
    written = {name: columns[name] for pair in (PAIRS[0], *pairs) for name in pair}
    beyond, folded = rows_beyond_zenith([columns[name] for name in PAIRS[0]],
                                        [columns[name] for name in pairs[0]], table.reasons == 0)
    if not beyond.any():
        return
    with np.errstate(invalid='ignore'):
        columns['az'], columns['el'] = through_pole(columns['az'], columns['el'], beyond)
        for _, el in pairs:
            columns[el] = np.where(beyond, unfolded(columns['el'], columns[el]), columns[el])
    table.written = written
    _turn_on_sky(columns, beyond)
    table.meta['notes'].append(
        f'{int(beyond.sum())} of {len(beyond)} rows are beyond the zenith: azimuth half a turn on, '
        'elevation beyond 90 degrees' + (f', which is folded back in {int(folded.sum())}'
                                         if folded.any() else ''))


def rows_beyond_zenith(place, reads, sound):
    """Which rows of an alt-azimuth mount are beyond its zenith.

    There the azimuth reading is half a turn off and the elevation is beyond 90 degrees, or is
    folded back below it so that only the azimuth shows it.

    Parameters
    ----------
    place, reads : pair of ndarray, shape (n,)
        Azimuth and elevation on the sky, and the mount's readings, radians.
    sound : ndarray of bool, shape (n,)
        Rows to test.

    Returns
    -------
    beyond, folded : ndarray of bool, shape (n,)
        `folded`: rows beyond the zenith whose elevation is folded back. Both are all False if less
        than `_MOST` of the readings are near their places, on either side of the zenith: the check
        of the columns handles that.
    """
    sound = sound & np.isfinite(sum((*place, *reads)))
    place, reads = ([np.where(sound, v, 0.0) for v in pair] for pair in (place, reads))
    away = wrap(reads[0] - place[0])
    high = is_beyond(reads[1])
    near = [np.abs(wrap(reads[1] - to)) < _NEAR for to in (place[1], np.pi - place[1])]
    turn = wrap(away - _zero(away[sound & ~high]))
    half = (np.cos(turn) < 0.0) & (np.abs(wrap(turn + np.pi)) * np.cos(place[1]) < _NEAR)
    # nearer to the zenith a tilt of the axis changes the azimuth as much
    folded = sound & ~high & half & near[0] & (place[1] < 0.5 * np.pi - _NEAR)
    # one or two rows far from the zenith have a wrong azimuth
    low = folded & (place[1] < _LOW)
    folded &= ~low | (low.sum() >= _FEWEST)
    beyond = sound & high & half & near[1] | folded
    straight = sound & ~beyond & near[0] & (np.abs(turn) * np.cos(place[1]) < _NEAR)
    most = (beyond | straight).sum() >= _MOST * sound.sum()
    return beyond & most, folded & most


def unfolded(el, reading):
    """Elevation readings beyond 90 degrees, whether folded back or not, near the places `el`."""
    return el + wrap(np.where(is_beyond(reading), reading, np.pi - reading) - el)


def _zero(away):
    """Azimuth zero of readings, some of which may be half a turn off."""
    if not len(away):
        return 0.0
    zero = 0.5 * np.angle(np.exp(2j * away).sum())
    return zero if np.cos(away - zero).mean() > 0.0 else zero + np.pi


def _turn_on_sky(columns, beyond):
    for name in ('miss_x', 'miss_y', 'x_arcsec', 'y_arcsec'):
        if name in columns:  # on the sky; beyond the pole both axes increase the other way
            columns[name] = np.where(beyond, -columns[name], columns[name])


def _keep_written(path, table, pairs, side, mount):
    """Set ``table.written``: the angles of the axes before rows are placed beyond the pole.

    `side`: the column ``pier_side``, or the mask derived from it. It is also kept if readings
    beyond the pole override it: in a unit other than degrees none of them may really be beyond.
    """
    if not pairs:  # offsets on the sky: the readings are computed from the places
        return
    columns = table.columns
    place = columns['az'], columns['el']
    if table.meta.get('from_horizon'):
        place = mount.axes_of(*place)
    table.written = {**dict(zip(PAIRS[0], place)),
                     **{name: columns[name] for pair in pairs for name in pair}}
    if side is None:
        return
    if side.dtype != bool:
        try:
            side = through_the_pole(path, replace(table, meta={'notes': []},
                                                  reasons=table.reasons.copy()), side, place[0])
        except ValueError:
            return
    table.written['beyond'] = side


def _air(columns, rows, site, weather, meta):
    """Air of some rows from `refraction.air_of_rows`; a given `Weather` applies as a whole."""
    from pointing_model.sky.refraction import Weather, air_of_rows
    own = {name: columns[name][rows] for name in ('pressure', 'temperature') if name in columns}
    if isinstance(weather, Weather):
        declared, weather = None, vars(weather)
    else:
        declared = meta.get('weather')
    height = site.height if 'height' in known_site(meta) else None
    air, notes = air_of_rows(height, **own, declared=declared, given=weather)
    meta['notes'] += notes
    return air


def read_offsets(table):
    """Encoder angles from offsets on the sky `x_arcsec`, `y_arcsec`, encoder - catalogue."""
    columns = table.columns
    if 'x_arcsec' not in columns:
        return
    x, y = columns.pop('x_arcsec'), columns.pop('y_arcsec')
    reach = np.cos(columns['el'])
    with np.errstate(invalid='ignore', divide='ignore', over='ignore'):
        table.exclude(np.abs(x) >= np.pi * np.abs(reach),
                      'x_arcsec is more than half a turn of azimuth, so near the zenith')
        columns['az_enc'] = columns['az'] + np.where(table.reasons == 0, x / reach, 0.0)
        columns['el_enc'] = columns['el'] + y
    table.meta['raw_reading'] = False
    table.meta['notes'].append('encoder angles computed as catalogue plus offset: the file has no '
                               'encoder readings')


def note_no_error(table):
    """Add a note if the pointing errors are smaller than any mount's: they are no measurements."""
    az, el, az_enc, el_enc = (table.columns[name][table.reasons == 0] for name in REQUIRED)
    if len(az) < _FEWEST:
        return
    typical = np.median(np.hypot(wrap(az_enc - az) * np.cos(el), wrap(el_enc - el))) / ARCSEC
    if typical < _LEAST:
        table.meta['notes'].insert(0, (
            f'readings and places differ by {typical:.2g} arcsec in most rows, less than on any '
            'mount: are the readings commanded places, or offsets in another unit?'))


def from_south(columns):
    """Convert azimuths from 0 south, 90 east to 0 north, 90 east; their sense is reversed."""
    for name in ('az', 'az_enc', 'az_abs', 'az_raw'):
        if name in columns:
            columns[name] = np.pi - columns[name]
    for name in ('az_rate', 'approach_az', 'miss_x'):
        if name in columns:
            columns[name] = -columns[name]
