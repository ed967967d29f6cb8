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

"""Applies a model to a table of directions: for the command ``apply``.

Right ascensions and declinations are converted to axis angles of a perfect mount at their times.
"""

import sys
from pathlib import Path

import numpy as np

from msg_tools.units import ARCSEC, DEG
from pointing_model.context import UNKNOWN, Context
from pointing_model.effects.base import readable
from pointing_model.model_application import NEWEST, axis_angles, turned, zeros_of_rows
from pointing_model.mounts import is_beyond, through_pole
from pointing_model.runs.columns.cell_values import TextRows, decimal_points, is_number
from pointing_model.runs.columns.cells import Cells
from pointing_model.runs.columns.column_names import CSV_NAMES
from pointing_model.runs.columns.declarations import declarations
from pointing_model.runs.columns.pier_side import sides_of
from pointing_model.runs.columns.run_table import lines_of, own_name
from pointing_model.runs.columns.solve_columns import may_be_hours, refuse_hours
from pointing_model.runs.plate_solves.frames import ICRS, to_icrs
from pointing_model.runs.run import COLUMNS, column_name
from pointing_model.runs.run_reader import EQUINOXES
from pointing_model.sky.refraction import air_of_rows
from pointing_model.sky.site import SITE, Site, site_contradictions
from pointing_model.zero import carried_zeros
from pointing_model.zero_drift import KEY

from .commands.options import check_mount, given_air, given_site

#: columns of a table of places of the sky
SKY = ('ra_deg', 'dec_deg')


def apply_to_table(model, args):
    """Convert the directions of a table to encoder angles, or back.

    Parameters
    ----------
    model : PointingModel
    args : argparse.Namespace
        Arguments of the command.

    Returns
    -------
    rows : list of sequence
        Header and cells.
    delimiter : str
    notes : list of str
    """
    table, declared = _table(args.file)
    more = _take_declared(args, declared, model.mount)
    header, lines, reasons = table.header, table.lines, table.reasons
    rows = [table.column(i) for i in range(len(header))]
    cells = dict(zip(header, rows))
    places, readings = ([column_name(f'{axis}{part}', model.mount.names) for axis in ('az', 'el')]
                        for part in ('', '_enc'))
    of_sky = not args.reverse and set(SKY) <= set(cells) and places[0] not in cells
    pair = readings if args.reverse else SKY if of_sky else places
    columns, notes = _drivers(table, cells, pair, places, args)
    notes += [*more, *declared['notes']]
    if not of_sky and (args.equinox != 'auto' or given_air(args)):
        raise ValueError(f'{table.path}: --equinox, --pressure and --temperature apply to '
                         'ra_deg, dec_deg, which are not used here; leave them out')
    az, el = (_angles(table, column, cells) for column in pair)
    if of_sky:
        check_sky(table, az, el, cells)
    else:
        _check(table, pair, az, el, args.reverse or not model.mount.vertical, model.mount, cells)
    # excluded rows take part with a dummy direction; their cells stay empty
    used = reasons == 0
    az, el = np.where(used, az, 0.0), np.where(used, el, 45.0)
    folded = np.zeros(len(used), bool)  # places of the sky reached through the pole
    if of_sky:
        az, el, height = observed(model, az, el, columns, cells, used, args, declared, notes)
        if (used & (height < 0.0)).any():
            notes.append(f'below the horizon: {_rows(lines[used & (height < 0.0)])}')
    elif model.mount.two_sided and 'pier_side' in cells:
        side, more = sides_of(table.path, cells['pier_side'], az * DEG, used)
        folded = used & ~is_beyond(el * DEG) & (side == 1.0)
        notes += more
        az, el = np.array(through_pole(az * DEG, el * DEG, folded)) / DEG
    place = [None if v is None else v * DEG for v in (args.latitude, args.longitude)]
    context = Context(az * DEG, el * DEG, columns, *place, mount=model.mount)
    if 'run' in columns and used.any():
        columns['run'] = np.where(used, columns['run'], columns['run'][used][0])
    zero, applied = zeros_of_rows(model, args.zero, columns.get('run'))
    out = np.stack(turned(model, context, zero, args.reverse)) / DEG
    notes += [*_zero_notes(model, applied, columns.get('run'), args.zero), *_unknown(
        model, context, out, args.reverse)]
    notes += [f'cells left empty in {_rows(lines[reasons == why])}: {why}'
              for why in dict.fromkeys(reasons[~used])]
    bad = ~np.isfinite(out).all(axis=0) & used
    out[:, ~used] = np.nan
    if bad.any():
        notes.append('directions that the axes cannot reach, too near the zenith of the mount: '
                     f'cells left empty in {_rows(lines[bad])}')
    seen = used & ~bad
    at = np.array([az, el])[:, seen] if not args.reverse else out[:, seen]
    notes += _open(model, at * DEG, lines[seen])
    # first axis: its catalogue place, or its reading
    up = (np.mod(az, 360.0) > 180.0) & used & (model.mount.two_sided)
    if up.any():
        notes.append(f'counterweight up in {_rows(lines[up])}; with it down the same place is '
                     'through the pole, at hour angle + 180, 180 - declination')
    if folded.any():
        notes.append(f'{int(folded.sum())} of {len(folded)} rows are through the pole (pier_side): '
                     'their angles are written as places on the sky, as on the other side')
        out = np.array(through_pole(*(out * DEG), folded)) / DEG
    names = places if args.reverse else readings
    if set(names) & set(header):
        names = tuple(f'{n.removesuffix("_deg")}_model_deg' for n in names)
        notes.append(f'the file already has these columns; the converted angles are in '
                     f'{", ".join(names)}')
    if of_sky:  # angles of a perfect mount, in front of those of this one
        names = (*(f'{n.removesuffix("_deg")}_observed_deg' for n in places), *names)
        out = np.vstack((np.where(used, (az, el), np.nan), out))
    texts = [['' if v != v else repr(v) for v in column] for column in out.tolist()]
    if any(decimal_points(cells[column]) is not cells[column] for column in pair):
        texts = [[text.replace('.', ',') for text in column] for column in texts]
    return [[*header, *names], *zip(*rows, *texts)], table.delimiter, notes


def _take_declared(args, declared, mount):
    """Use the site in a table's comments unless an option gives it; refuse that of another mount.

    Returns notes. The keys of `declared`: see `declarations`.
    """
    site, given = declared.get('site', {}), given_site(args)
    for one in SITE.values():
        if one.field in {*site} - {*given}:
            setattr(args, one.field, site[one.field] / one.size)
    args.mount = args.mount or declared.get('mount_declared')
    check_mount(args, args.model, mount)
    return site_contradictions(given, site)


def _table(file):
    """The cells of the table, and declarations in the comments above them."""
    if file == '-':
        name = 'standard input'
        if sys.stdin.isatty():
            print('directions are read from the terminal; end with Ctrl-D', file=sys.stderr)
        data = sys.stdin.buffer.read()
    else:
        name, data = file, Path(file).read_bytes()
    lines = lines_of(name, data)
    return Cells(name, lines), declarations(name, lines, header=True)


def _angles(table, column, cells):
    """A column of angles; ValueError if it is missing, or most cells are not numbers."""
    if column not in cells:
        there = ', '.join(c[:40] for c in list(cells)[:40])
        raise ValueError(f'{table.path}: no column {column}; the file has {there}')
    values = table.floats(column, cells[column])
    empty = np.flatnonzero(~np.isfinite(values) & (table.reasons == 0))
    table.refuse(column, [cell or 'empty' for cell in cells[column]],
                 {int(i): 'is no angle' for i in empty})
    return values


def _check(table, pair, az, el, beyond, mount, cells):
    """Refuse values that are not directions in degrees."""
    # beyond zenith or pole, to the end of the travel
    reach = [-180.0, 180.0, *mount.names.travel_deg[1]] if beyond else [-90.0, 90.0]
    with np.errstate(invalid='ignore'):
        bad = (el < min(reach)) | (el > max(reach))
    table.refuse(pair[1], cells[pair[1]], {
        int(i): 'is no such angle in degrees' for i in np.flatnonzero(bad)})
    az, el = az[table.reasons == 0], el[table.reasons == 0]
    if len(el) >= 3 and np.abs(el).max() <= 1.6 and np.abs(az).max() <= 6.3 and np.ptp(el) > 0.05:
        raise ValueError(f'{table.path}: {pair[0]}, {pair[1]} never exceed '
                         f'{max(np.abs(az).max(), np.abs(el).max()):.3g}: they look like radians; '
                         'give degrees')


def _drivers(table, cells, pair, places, args):
    """Drivers for the effects, in SI by their internal names; notes."""
    given = {}
    for text in args.given:
        key, equals, value = text.partition('=')
        if not equals or not key.strip():
            raise ValueError(f'--set {text}: write COLUMN=VALUE, as temperature_c=4.5')
        given[key.strip()] = value.strip()
    if args.time is not None:
        given['time'] = args.time
    cells = {**cells, **{key: [value] * len(table) for key, value in given.items()}}
    out, notes = {}, []
    for column, values in cells.items():
        if column in pair or column in places or not column:
            continue
        known = CSV_NAMES.get(column)
        # an error in a value for all rows affects all
        rows = TextRows('the options', table.lines, strict=True) if column in given else table
        if column == 'time':
            out['time'] = rows.times(column, values)
        elif known == 'star' and not all(map(is_number, values)):
            continue
        elif known in COLUMNS:
            numbers = rows.floats(column, values)
            rows.refuse(column, values, {
                int(i): 'is not finite' for i in np.flatnonzero(np.isinf(numbers))})
            out[known] = numbers * COLUMNS[known][1]
        elif values and all(not v or is_number(v) for v in decimal_points(values)):
            out[own_name(column, cells, notes)] = rows.floats(column, values)
        elif column in given:
            raise ValueError(f'--set {column}={given[column]}: is not a number')
    if 'star' in out:
        out['star'] = np.nan_to_num(out['star']).astype(np.int64)
    return out, notes


def _zero_notes(model, applied, run, wanted):
    """Notes on the zeros stored in the model."""
    known = carried_zeros(model)
    if not known:
        return ['the column run is not used: the model carries no zeros of runs'
                ] if run is not None and wanted == NEWEST else []
    if not applied:
        return [f'the {len(known)} zeros that the model carries are not applied (--zero none)']
    if not any(z.angles.any() for z in applied):  # they are in the index terms
        return []
    zeros = ', '.join(f'run {z.run:g}: azimuth {z.az / ARCSEC:+.2f}, elevation '
                      f'{z.el / ARCSEC:+.2f} arcsec' for z in applied[:6])
    more = f', ... ({len(applied)} runs)' if len(applied) > 6 else ''
    notes = [f'zero applied, {zeros}{more}']
    if KEY in model.provenance:
        notes.append('in the night the absolute encoder tracks the zero of this model; here the '
                     'zero is used as it was set')
    return notes


def _unknown(model, context, out, reverse):
    """Notes on effects that count as zero, and why."""
    if not model.effects:
        return []
    if reverse:
        context = context.at(*np.nan_to_num(out * DEG), az_raw=context.az, el_raw=context.el)
    alike = {}
    needs = {e.effect.name: e.effect.requires for e in model.effects}
    for effect, rows in model.unknown(context.az, context.el, context).items():
        count = int(np.count_nonzero(rows))
        where = 'all rows' if count == len(rows) else f'{count} of {len(rows)} rows'
        reasons = dict.fromkeys(UNKNOWN.get(name, f'{name} is not known') for name in needs[effect]
                                if (value := context.get(name)) is None
                                or not np.isfinite(value[rows]).all())
        alike.setdefault((where, '; '.join(reasons)), []).append(readable(effect))
    # in a model for prediction dozens of effects may lack the same driver
    return [f'{_some(names)} {"count" if len(names) > 1 else "counts"} as zero in {where}: {why}'
            for (where, why), names in alike.items()]


def _some(names, most=3):
    """Names; of many only some, and the number of others."""
    if len(names) <= most + 1:
        return ', '.join(names)
    return f'{", ".join(names[:most])} and {len(names) - most} more'


def _open(model, places, lines):
    """Note on rows whose prediction rests on what the stars of the fit did not determine."""
    rows = model.is_open(*places)
    if not rows.any():
        return []
    where = _rows(lines[rows])
    names = (*model.undetermined, *model.undetermined_harmonics)
    if names:
        return [f'prediction error unknown in {where}: the stars of the fit do not determine the '
                f'terms {", ".join(names)}']
    return [f'prediction error unknown in {where}: no row of the fit was on this side '
            'of the pier']


def _rows(lines, limit=20):
    texts = ', '.join(str(n) for n in lines[:limit])
    more = f', ... ({len(lines)} rows)' * (len(lines) > limit)
    return f'row{"s" * (len(lines) > 1)} {texts}{more}'


def check_sky(table, ra, dec, cells):
    """Refuse values that are not right ascensions and declinations in degrees."""
    with np.errstate(invalid='ignore'):
        for name, bad in zip(SKY, ((ra < 0.0) | (ra > 360.0), np.abs(dec) > 90.0)):
            table.refuse(name, cells[name], {
                int(i): 'is no such angle in degrees' for i in np.flatnonzero(bad)})


def observed(model, ra, dec, columns, cells, used, args, declared, notes):
    """Angles that a perfect mount of this kind reads at places of the sky.

    Parameters
    ----------
    model : PointingModel
    ra, dec : ndarray, shape (n,)
        Degrees, in the frame that ``args.equinox`` or the table gives, else ICRS.
    columns : dict of str to ndarray
        Drivers in SI: ``time``, and air if given.
    cells : dict
        Cells of the table, for ``pier_side``.
    used : ndarray of bool, shape (n,)
        Rows that are not excluded.
    args : argparse.Namespace
        Arguments of the command: site, air, equinox.
    declared : dict
        Frame and air from the table's comments.
    notes : list of str
        New notes are appended.

    Returns
    -------
    first, second : ndarray, shape (n,)
        Degrees; on the side of the pier in the table, else with the counterweight down.
    height : ndarray, shape (n,)
        Above the horizon, degrees.

    Raises
    ------
    ValueError
        No time or site, a latitude that is not the mount's, or hours instead of degrees.
    """
    if 'time' not in columns:
        raise ValueError('ra_deg, dec_deg need the time: a column time, or --time UTC')
    if args.longitude is None or (args.latitude is None and not model.mount.celestial):
        raise ValueError('ra_deg, dec_deg need the site: --latitude and --longitude')
    time = columns['time']
    if not np.isfinite(time[used]).all():
        raise ValueError('ra_deg, dec_deg need the time of every row')
    air, said = air_of_rows(args.height, columns.get('pressure'), columns.get('temperature'),
                            declared.get('weather'), given_air(args))
    notes += said
    how = {'longitude_deg': args.longitude, 'latitude_deg': args.latitude,
           'height_m': args.height or 0.0, 'pressure_hpa': air.pressure_hpa,
           'temperature_c': air.temperature_c}
    time = np.where(used, time, time[used][0] if used.any() else 0.0)
    latitude = model.mount.latitude if args.latitude is None else args.latitude * DEG
    refuse_hours(args.file, ra[used] * DEG, dec[used] * DEG, time[used],
                 Site(latitude, args.longitude * DEG, args.height or 0.0))
    if may_be_hours(ra[used]):
        notes.append(f'ra_deg never exceeds {ra[used].max():.3g}: taken as degrees; are these '
                     'hours?')
    frame = EQUINOXES.get(args.equinox) or declared.get('sky_frame', ICRS)
    if frame != declared.get('sky_frame', frame):
        notes.append(f'places read as {frame.text}, although the table declares '
                     f'{declared["sky_frame"].text}')
    ra, dec = (np.degrees(v) for v in to_icrs(ra * DEG, dec * DEG, frame, time))
    found = axis_angles(model, ra, dec, time, **how)
    if not (model.mount.two_sided and 'pier_side' in cells):
        return found
    down = is_beyond(found[1] * DEG)
    star = through_pole(found[0] * DEG, found[1] * DEG, down)[0]
    side, more = sides_of(args.file, cells['pier_side'], star, used)
    notes += more
    return axis_angles(model, ra, dec, time, beyond=np.where(np.isfinite(side), side == 1.0, down),
                       **how)
