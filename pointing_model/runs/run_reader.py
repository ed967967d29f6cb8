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

"""Read pointing runs; the format of a file is recognised by its content."""

from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

from pointing_model.mounts import ALTAZ, Mount, parse_mount
from pointing_model.runs.plate_solves.frames import ICRS, OF_DATE
from pointing_model.runs.run import PointingRun, known_site
from pointing_model.sky.site import site_contradictions

from . import formats
from .columns import axis_places, hints, row_checks, solve_columns
from .columns.approach import derive_approach
from .columns.cell_values import is_number
from .columns.run_table import content, read_lines
from .columns.written_steps import note_steps
from .copies import flag_solved_twice
from .formats import csv
from .formats.images import read_images

_MODULES = [import_module(f'{formats.__name__}.{module.name}')
            for module in iter_modules(formats.__path__)]
#: formats declared by the modules of `formats`, in the order in which they are tried
FORMATS = sorted((module.FORMAT for module in _MODULES if hasattr(module, 'FORMAT')),
                 key=lambda one: one.rank)
_TITLES = 10  # at most this many rows above the column names are reported
#: values of the option equinox -> frame of the catalogue places
EQUINOXES = {'j2000': ICRS, 'date': OF_DATE}


def read_run(path, *, azimuth_origin=None, site=None, weather=None, encoder=None, mount=None,
             equinox=None):
    """Read a pointing run; the kind of file is recognised by its content.

    Parameters
    ----------
    path : str or Path
        CSV (column names of `COLUMNS`, any order; other numeric columns are kept under their
        own names, or as ``column_<name>`` if the name is reserved), TPOINT
        (``ALTAZ``, format 4: observed azimuth and elevation, then those of the mount; also the
        short form with a line ``A``), a raw MMT night, or a pointing log of the IRAM 30 m. A
        CSV may give ``x_arcsec, y_arcsec`` (encoder - catalogue, on the sky) in place of the
        encoder columns, and ``ra_deg, dec_deg, time`` in place of ``az_deg, el_deg``, in the frame
        and at the site that comments above the header row declare (docs/plate_solved.md).
        For equatorial mounts: CSV with ``ha_deg, dec_deg, ha_enc_deg, dec_enc_deg`` (or
        ``ra_deg, dec_deg, time`` and these readings; ``ra_enc_deg`` with the time for
        ``ha_enc_deg``), exports of TheSky and TPOINT with
        ``:EQUAT``, the short form with a line ``E``, the 12 columns of the UNAM control system.
        For solved images: models of MountWizzard4 (JSON), input of RTS2's gpoint, and a YAML file
        that names the keywords of the FITS images with a WCS beside it (docs/plate_solved.md).
    azimuth_origin : {'N', 'S'}, optional
        'N': azimuth 0 is north, 90 east. 'S': 0 is south, 90 east (azimuths are converted to
        180 deg - A). By default from a comment in a TPOINT file, else 'N'.
    site : pointing_model.sky.site.Site, or dict with some of its fields, optional
        Needed for ``ra_deg, dec_deg`` if the file declares no site. It replaces the file's in
        ``meta['site']``; a dict replaces only the fields it has. A note reports contradictions.
    weather : pointing_model.sky.refraction.Weather or dict, optional
        For the refraction of ``ra_deg, dec_deg`` in rows without ``temperature_c`` and
        ``pressure_hpa``. Missing values are taken from the file, else from a standard atmosphere
        at the site, 10 C.
    encoder : {'enc', 'abs'}, optional
        'abs' swaps the first and the second encoder.
    mount : str or Mount, optional
        Replaces the mount of the file, see `mounts.parse_mount`.
    equinox : {'j2000', 'date'}, optional
        Equinox of ``ra_deg, dec_deg``: J2000 (ICRS), or apparent places of date. By default as the
        file declares, else ICRS, or for exports of TheSky and TPOINT the one that fits better.

    Returns
    -------
    PointingRun
        Angles in radians, azimuth from north through east. For other than alt-azimuth mounts they
        are angles of the axes, each row on its pier side. ``meta``: ``mount`` if it is not
        alt-azimuth, ``source``, ``format``, ``azimuth_origin``, ``site``, ``excluded`` (``row`` is
        the line in the file), ``lines`` (of the rows kept, shape (n,)) and ``notes``; for TPOINT
        also ``caption``, ``date`` and ``weather`` if given. ``time_is_utc`` is False if ``time``
        counts from an arbitrary start, ``raw_reading`` is False if the encoder angles are not raw
        readings.

    Raises
    ------
    NoObservations
        A ValueError: a valid file with a header and no row.
    ValueError
        One line: the file, the row, the column, and what is wrong.
    OSError
        The file cannot be opened.
    """
    path = Path(path)
    if azimuth_origin not in (None, 'N', 'S'):
        raise ValueError(f'azimuth origin {azimuth_origin!r} is neither N nor S')
    if encoder not in (None, 'enc', 'abs'):
        raise ValueError(f"encoder {encoder!r} is neither 'enc' nor 'abs'")
    if equinox not in (None, *EQUINOXES):
        raise ValueError(f'equinox {equinox!r} is none of {", ".join(EQUINOXES)}')
    try:
        return _read_run(path, azimuth_origin, site, weather, encoder, mount, equinox)
    except ValueError as error:
        # names and cells of a foreign file may hold anything
        text = ''.join(c if c.isprintable() else '?' for c in str(error))
        renewed = type(error)(text)
        renewed.__dict__.update(error.__dict__)
        raise renewed from None


def _read_run(path, azimuth_origin, site, weather, encoder, mount, equinox):
    table = _read_table(path, encoder)
    columns, meta = table.columns, {'source': str(path), **table.meta}
    table.meta = meta
    if encoder == 'abs':
        swap_encoders(path, columns, meta)
    if weather and 'ra_deg' not in columns:
        meta['notes'].append('--pressure and --temperature change nothing: the places are taken as '
                             'refracted')
    altazimuth = table.names is ALTAZ.names and 'lst_given' not in columns
    _settle_origin(azimuth_origin, meta, altazimuth)
    if site is not None:
        meta['notes'] += site_contradictions(known_site({'site': site}), known_site(meta))
        meta['site'] = {**(meta.get('site') or {}), **site} if isinstance(site, dict) else site
    if equinox is not None:
        _settle_equinox(path, table, equinox)
    mount = _settle_mount(path, table, mount)
    row_checks.refuse_radians(path, table)
    solve_columns.take_sigma(table)
    flag_solved_twice(table)
    solve_columns.flag_scales(table)
    row_checks.to_si(columns)
    row_checks.flag_numbers(table)
    row_checks.blank_absurd(table)
    row_checks.bridge_gaps(table)
    note_steps(table)
    axis_places.observe_places(path, table, weather, meta['azimuth_origin'], mount)
    axis_places.mount_ascension(path, table)
    if mount.vertical:
        meta.pop('from_horizon', None)
    else:
        axis_places.to_axes(path, table, mount)
    axis_places.read_offsets(table)
    axis_places.note_no_error(table)
    if meta['azimuth_origin'] == 'S':
        axis_places.from_south(columns)
    row_checks.flag_rows(table, mount)
    row_checks.note_hasty_clock(table)
    if mount.vertical:
        axis_places.past_zenith(table)
    derive_approach(table)
    return PointingRun(row_checks.finish(path, table), meta)


def _settle_mount(path, table, given):
    """The mount: the given one, else that of the file, else from the names of its columns."""
    meta = table.meta
    declared = meta.pop('mount_declared', None)
    mount = given or declared
    if mount is None and table.names is ALTAZ.names:
        return ALTAZ
    meta['mount_assumed'] = mount is None
    if not isinstance(mount, Mount):
        latitude = known_site(meta).get('latitude')
        if mount is None and not table.names.celestial:
            raise ValueError(f'{path}: the mount of the columns axis1, axis2 is missing: give a '
                             'line "# mount: free:AZ,EL", or --mount')
        try:
            mount = parse_mount(mount or 'equatorial', latitude)
        except ValueError as error:
            if 'latitude' not in str(error):
                raise ValueError(f'{path}: {error}') from None
            # right ascensions need the longitude too: ask for both at once
            both = 'ra_deg' in table.columns and not known_site(meta).get('longitude')
            raise ValueError(
                f'{path}: {error}' + (', and its longitude' if both else '') +
                ' (a line "# latitude_deg: 31.05" before the header, or --latitude DEG'
                + (' --longitude DEG' if both else '') + ')') from None
    if mount.names.columns != table.names.columns:
        first, second = mount.names.columns
        raise ValueError(f'{path}: the columns are of {" and ".join(table.names.axes)}; those of '
                         f'{mount.names.words} are {first}_enc_deg, {second}_enc_deg')
    if not mount.vertical:
        meta['mount'] = mount
    return mount


def _read_table(path, encoder):
    if path.suffix.lower() in ('.yaml', '.yml') and path.is_file():  # which keywords are what
        return read_images(path)
    lines = read_lines(path)
    for one in FORMATS:
        if one.looks_like(lines):
            table = one.read(path, lines, encoder) if one.of_encoder else one.read(path, lines)
            table.meta['taken'] = one.taken
            return table
    body = content(lines)
    for number, _ in body[1:_TITLES]:
        if csv.looks_like(lines[number - 1:]):
            raise ValueError(f'{path}: row {number} names the columns; put a # before the rows '
                             'above it')
    for delimiter in (',', ';', '\t', None):
        cells = [cell.strip() for cell in body[0][1].split(delimiter)] if body else []
        if len(cells) > 3 and sum(map(is_number, cells)) >= 4 and (delimiter or len(body) > 1):
            raise ValueError(hints.without_header(path, body, delimiter))
    if path.suffix.lower() == '.json':
        raise ValueError(f'{path} is not a pointing run: apply, bolts, export --to and the option '
                         '--base take models')
    raise ValueError(f'{path} is not a pointing run: expected '
                     f'{", ".join(one.wording for one in FORMATS)}, or the YAML of a folder of '
                     'solved images')


def swap_encoders(path, columns, meta):
    """Swap the first and the second encoder, in place.

    Raises
    ------
    ValueError
        There is no second encoder.
    """
    if 'az_abs' not in columns or 'el_abs' not in columns:
        raise ValueError(f'{path} has no second encoder')
    for axis in ('az', 'el'):
        first = columns.pop(f'{axis}_enc', None)
        columns[f'{axis}_enc'] = columns.pop(f'{axis}_abs')
        columns.pop(f'{axis}_raw', None)  # raw readings of the first encoder
        if first is not None:
            columns[f'{axis}_abs'] = first
    graduations = {name: meta.pop(name) for name in ('graduation', 'graduation_abs')
                   if name in meta}
    for name, other in (('graduation', 'graduation_abs'), ('graduation_abs', 'graduation')):
        if name in graduations:
            meta[other] = graduations[name]
    meta['notes'].append('the second (absolute) encoder was read in place of the first')


def _settle_origin(given, meta, altazimuth):
    declared, west = meta.pop('told_origin', None), meta.pop('told_west', False)
    meta['azimuth_origin'] = given or declared or 'N'
    if not altazimuth:
        meta['azimuth_origin'] = 'N'
        meta['notes'] += [f'azimuth origin {given} changes nothing: this mount has no azimuth'] * (
            given is not None)
        return
    if declared and given and declared != given:
        meta['notes'].append(f'azimuth 0 read as {given}, although the file declares '
                             f'{declared}')
    elif declared or given or west:
        meta['notes'].append(
            'azimuth read from ' + {'N': 'north', 'S': 'south'}[meta['azimuth_origin']]
            + f' through {"west" if west else "east"}, as '
            + ('the file says' if declared or west else 'requested'))
    elif meta['format'] == 'tpoint':
        meta['notes'].append('azimuth read from north through east: the file does not say')


def _settle_equinox(path, table, given):
    """Replace the equinox of the file by the given one.

    Raises
    ------
    ValueError
        The file has no catalogue places.
    """
    if 'ra_deg' not in table.columns:
        raise ValueError(f'{path}: --equinox needs right ascensions and declinations of a '
                         'catalogue, and this file has none; leave it out')
    frame, declared = EQUINOXES[given], table.meta.get('sky_frame')
    if declared is not None and declared != frame:
        table.meta['notes'].append(f'places read as {frame.text}, although the file declares '
                                   f'{declared.text}')
    table.meta.update(sky_frame=frame, equinox_given=given)
