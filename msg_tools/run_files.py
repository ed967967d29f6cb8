"""Pointing runs from files: our CSV, TPOINT, and the raw nights of the MMT."""

import csv
import difflib
import re
from pathlib import Path

import numpy as np

from pointing_model.run import COLUMNS, REQUIRED, PointingRun
from pointing_model.units import DEG, wrap

CSV_NAMES = {csv_name: name for name, (csv_name, _, _) in COLUMNS.items()}
#: observed elevations outside are no observation (90.1: a star past the zenith)
ELEVATION_LIMITS = (-5.0, 90.1)
_PAIRS = (('az', 'el'), ('az_enc', 'el_enc'), ('az_abs', 'el_abs'))
_TEXT = ('star', 'block', 'run')  # may hold names in place of numbers
_KINDS = ('a CSV file with a header row (az_deg, el_deg, az_enc_deg, el_enc_deg, ...), a TPOINT '
          'file (caption, ": ALTAZ", latitude, rows of 4 numbers) or a raw MMT night (CAT:, '
          'RAA:, TAA:)')


def read_run(path, *, azimuth_origin=None, site=None, encoder=None):
    """Read a pointing run; the kind of file is told from its content.

    Parameters
    ----------
    path : str or Path
        CSV (columns by the names of `COLUMNS`, any order; a further numeric column is kept
        under its own name), TPOINT (``ALTAZ``, format 4: observed azimuth and elevation, then
        those of the mount; also the short form with a line ``A``), or a raw MMT night.
    azimuth_origin : {'N', 'S'}, optional
        'N': azimuth 0 is north, 90 east. 'S': 0 is south, 90 east (azimuths are converted to
        180 deg - A). By default what a comment in a TPOINT file says, else 'N'.
    site : object, optional
        Kept as ``meta['site']`` in place of what the file tells; if it has a ``latitude``
        (rad) that differs from the file's, ``meta['notes']`` says so.
    encoder : {'enc', 'abs'}, optional
        'abs' takes the second encoder for the first, and the first for the second.

    Returns
    -------
    PointingRun
        Angles in radians, azimuth from north through east. ``meta``: ``source``, ``format``,
        ``azimuth_origin``, ``site``, ``excluded`` (``row`` is the line in the file) and
        ``notes``; TPOINT also ``caption``, ``date`` and ``weather`` where they are given.

    Raises
    ------
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
    lines = _read_lines(path)
    if any(line.startswith('CAT:') for line in lines[:50]):
        table = _read_mmt(path, lines)
    else:
        delimiter = _csv_delimiter(lines)
        if delimiter:
            table = _read_csv(path, lines, delimiter, encoder)
        elif _looks_like_tpoint(lines):
            table = _read_tpoint(path, lines)
        else:
            raise ValueError(f'{path} is not a pointing run: expected {_KINDS}')
    columns, rows, meta = table
    meta = {'source': str(path), **meta}
    meta.setdefault('notes', [])
    if encoder == 'abs':
        _swap_encoders(path, columns, meta)
    told = meta.pop('told_origin', None)
    meta['azimuth_origin'] = azimuth_origin or told or 'N'
    if told and azimuth_origin and told != azimuth_origin:
        meta['notes'].append(
            f'the file says that azimuth 0 is {told}, it was read with {azimuth_origin}')
    elif meta['format'] == 'tpoint' and not (told or azimuth_origin):
        meta['notes'].append('azimuth taken from north through east: the file does not say')
    if site is not None:
        _compare_site(site, meta)
        meta['site'] = site
    _refuse_radians(path, columns)
    for name, values in columns.items():
        if name in COLUMNS and COLUMNS[name][1] != 1.0:
            columns[name] = values * COLUMNS[name][1]
    if meta['azimuth_origin'] == 'S':
        _from_south(columns)
    keep = _sound_rows(path, columns, rows, meta)
    run = PointingRun({name: values[keep] for name, values in columns.items()}, meta)
    _derive_approach(run)
    return run


# ------------------------------------------------------------------------------------ the file

def _read_lines(path):
    if path.is_dir():
        raise ValueError(f'{path} is a folder, not a file with a pointing run')
    data = path.read_bytes()
    if data.startswith(b'\x89MCAP'):
        raise ValueError(f'{path} is an MCAP log, not a table of observations')
    if not data.strip():
        raise ValueError(f'{path} is empty')
    # control characters other than tab, newline, form feed, carriage return, DOS end of file
    if re.search(rb'[\x00-\x08\x0b\x0e-\x19\x1b-\x1f]', data):
        raise ValueError(f'{path} is a binary file, not a pointing run')
    try:
        text = data.decode('utf-8-sig')
    except UnicodeDecodeError:
        text = data.decode('latin-1')
    return text.replace('\x1a', '').splitlines()


def _content(lines, comment='#'):
    """(line number, text) of lines that are neither blank nor comments."""
    return [(number, line) for number, line in enumerate(lines, 1)
            if line.strip() and not line.lstrip().startswith(comment)]


def _is_number(text):
    try:
        float(text)
    except ValueError:
        return False
    return True


def _csv_delimiter(lines):
    """The delimiter if this is a table with a header row, else None."""
    content = _content(lines)[:2]
    if not content:
        return None
    first = content[0][1]
    for delimiter in ',;\t':
        names = [cell.strip().strip('"') for cell in first.split(delimiter)]
        if len(names) < 2 or any(_is_number(name) for name in names):
            continue
        known = any(name in CSV_NAMES for name in names)
        alike = len(content) > 1 and content[1][1].count(delimiter) == len(names) - 1 > 2
        if known or alike:
            return delimiter
    return None


def _looks_like_tpoint(lines):
    content = _content(lines, '!')
    if any(line.startswith(':') for _, line in content[:10]):
        return True
    return len(content) > 1 and content[1][1].strip().upper() in ('A', 'E')


# ----------------------------------------------------------------------------------- our CSV

def _read_csv(path, lines, delimiter, encoder):
    content = _content(lines)
    table = list(csv.reader([line for _, line in content], delimiter=delimiter))
    numbers = np.array([number for number, _ in content[1:]])
    if len(table) != len(content):
        raise ValueError(f'{path}: a quoted cell runs over the end of its line')
    header = [name.strip() for name in table[0]]
    twice = [name for name in header if header.count(name) > 1]
    if twice:
        raise ValueError(f'{path}: column {twice[0]!r} is there twice')
    _require(path, header, encoder)
    rows = table[1:]
    if not rows:
        raise ValueError(f'{path} has a header row but no observations')
    if set(map(len, rows)) != {len(header)}:
        bad = next(i for i, row in enumerate(rows) if len(row) != len(header))
        raise ValueError(f'{path}, row {numbers[bad]}: {len(rows[bad])} cells, but the header '
                         f'has {len(header)}')
    columns, notes = {}, []
    for header_name, cells in zip(header, zip(*rows)):
        cells = [cell.strip() for cell in cells]
        name = CSV_NAMES.get(header_name)
        if name == 'time':
            columns['time'] = _parse_time(path, numbers, cells)
        elif name in _TEXT:
            columns[name] = _numbers_or_text(cells)
        elif name:
            columns[name] = _floats(path, numbers, header_name, cells)
        elif header_name in COLUMNS:
            notes.append(f'column {header_name!r} left out: its unit is unknown, the name is '
                         f'{COLUMNS[header_name][0]}')
        elif header_name:
            try:
                columns[header_name] = _floats(path, numbers, header_name, cells)
            except ValueError:
                notes.append(f'column {header_name!r} left out: it is not numeric')
    return columns, _Rows(numbers, ['\0'.join(row) for row in rows]), {
        'format': 'csv', 'notes': notes}


class _Rows:
    """Where the rows came from: line numbers, and their text to find duplicates."""

    def __init__(self, numbers, texts):
        self.numbers = numbers
        self.texts = texts


def _require(path, header, encoder):
    required = [COLUMNS[name][0] for name in REQUIRED]
    if encoder == 'abs':
        required = [name.replace('_enc_', '_abs_') for name in required]
    missing = [name for name in required if name not in header]
    if not missing:
        return
    said = []
    for name in missing:
        near = difflib.get_close_matches(name, [h for h in header if h not in required], 1, 0.4)
        said.append(f'{name} (closest: {near[0]})' if near else name)
    hint = ''
    if encoder != 'abs' and {'az_abs_deg', 'el_abs_deg'} <= set(header):
        hint = "; encoder 'abs' reads az_abs_deg, el_abs_deg in their place"
    raise ValueError(f'{path}: no column {", ".join(said)}; the file has '
                     f'{", ".join(header)}{hint}')


def _floats(path, numbers, header_name, cells):
    try:
        return np.array([cell or 'nan' for cell in cells], dtype=float)
    except ValueError:
        bad = next(i for i, cell in enumerate(cells) if cell and not _is_number(cell))
        raise ValueError(f'{path}, row {numbers[bad]}, column {header_name}: '
                         f'{cells[bad][:40]!r} is not a number') from None


def _numbers_or_text(cells):
    try:
        values = np.array(cells, dtype=float)
    except ValueError:
        return np.array(cells, dtype=str)
    return _whole(values)


def _whole(values):
    """As integers where all are whole."""
    if np.all(np.isfinite(values)) and np.all(values == np.floor(values)):
        return values.astype(np.int64)
    return values


_ZONE = re.compile(r'(?:Z|([+-])(\d\d):?(\d\d)?)$')


def _split_zone(cell):
    """An ISO time without its zone, and the zone in seconds east of Greenwich."""
    clock = cell.find('T') if 'T' in cell else cell.find(' ')
    match = _ZONE.search(cell, clock) if clock > 0 else None
    if match is None:
        return cell, 0
    sign, hours, minutes = match.groups()
    seconds = int(sign + '1') * (int(hours) * 3600 + int(minutes or 0) * 60) if sign else 0
    return cell[:match.start()], seconds


def _parse_time(path, numbers, cells):
    try:
        return np.array([cell or 'nan' for cell in cells], dtype=float)
    except ValueError:
        pass
    plain, zones = zip(*map(_split_zone, cells))
    try:
        stamps = np.array([p or 'NaT' for p in plain], dtype='datetime64[ns]')
    except ValueError:
        stamps = None
    if stamps is None:
        for number, cell, p in zip(numbers, cells, plain):
            try:
                np.datetime64(p or 'NaT', 'ns')
            except ValueError:
                raise ValueError(
                    f'{path}, row {number}, column time: {cell[:40]!r} is neither ISO 8601 '
                    '(2021-08-21T04:36:01.5Z) nor seconds since 1970') from None
        raise ValueError(f'{path}, column time: mixes ISO 8601 and seconds')
    whole = stamps.astype('datetime64[s]')
    seconds = whole.astype(np.int64) + (stamps - whole).astype(np.int64) * 1e-9 - np.array(zones)
    return np.where(np.isnat(stamps), np.nan, seconds)


# ------------------------------------------------------------------------------------- TPOINT

def _read_tpoint(path, lines):
    comments = ' '.join(line for line in lines if line.lstrip().startswith('!'))
    # the first mention counts: a comment may go on about what another program does
    origin = re.search(r'\b(N|S|North|South)\s*=\s*0\b', comments, re.IGNORECASE)
    meta = {'format': 'tpoint', 'notes': [],
            'told_origin': origin.group(1)[0].upper() if origin else None}
    content = []
    for number, line in enumerate(lines, 1):
        line = line.split('!', 1)[0].strip()
        if line.upper() == 'END':
            break
        if line:
            content.append((number, line))
    if not content:
        raise ValueError(f'{path} holds only comments')
    meta['caption'] = content.pop(0)[1]
    options = [line[1:].strip().upper() for _, line in content if line.startswith(':')]
    content = [(number, line) for number, line in content if not line.startswith(':')]
    short = content and content[0][1].upper() in ('A', 'E')
    if short:
        options.append('ALTAZ' if content.pop(0)[1].upper() == 'A' else 'EQUATORIAL')
    if 'ALTAZ' not in [word for option in options for word in option.split()]:
        raise ValueError(f'{path}: no option ": ALTAZ"; runs of equatorial mounts are not read')
    if not content:
        raise ValueError(f'{path} ends before the line with the latitude')
    _run_parameters(path, *content.pop(0), meta)
    if not content:
        raise ValueError(f'{path} has a header but no observations')
    numbers = np.array([number for number, _ in content])
    cells = [line.split() for _, line in content]
    width = len(cells[0])
    if not 4 <= width <= 8:
        raise ValueError(f'{path}, row {numbers[0]}: {width} numbers; only format 4 (observed '
                         'azimuth and elevation, mount azimuth and elevation) is read')
    if set(map(len, cells)) != {width}:
        bad = next(i for i, row in enumerate(cells) if len(row) != width)
        raise ValueError(f'{path}, row {numbers[bad]}: {len(cells[bad])} numbers, but '
                         f'{width} in the first row')
    names = ['observed azimuth', 'observed elevation', 'mount azimuth', 'mount elevation']
    rotator = any(option.startswith('ROT') for option in options)
    names += ['rotator_deg' if rotator and i == 0 else f'auxiliary_{i + 1}'
              for i in range(width - 4)]
    columns = {
        key: _floats(path, numbers, name, column)
        for key, name, column in zip([*REQUIRED, *names[4:]], names, zip(*cells))}
    return columns, _Rows(numbers, [' '.join(row) for row in cells]), meta


def _run_parameters(path, number, line, meta):
    """Latitude (deg, or deg min sec), then date, temperature, pressure, height, humidity."""
    words = line.split()
    if not all(_is_number(word) for word in words):
        raise ValueError(f'{path}, row {number}: {line[:60]!r} is not the line of run '
                         'parameters, which begins with the latitude')
    values = [float(word) for word in words]
    latitude = abs(values[0])
    if len(values) >= 3:
        latitude += values[1] / 60.0 + values[2] / 3600.0
    if latitude > 90.0:
        raise ValueError(f'{path}, row {number}: latitude {line[:60]!r} is beyond 90 degrees')
    sign = -1.0 if words[0].startswith('-') else 1.0
    meta['site'] = {'latitude': float(sign * latitude * DEG)}
    if len(values) >= 6:
        meta['date'] = '{:04d}-{:02d}-{:02d}'.format(*map(int, values[3:6]))
    if len(values) >= 8:
        meta['weather'] = {'temperature_c': values[6], 'pressure_hpa': values[7]}
    if len(values) >= 9:
        meta['site']['height'] = values[8]
    if len(values) >= 10:
        meta['weather']['humidity'] = values[9]


# ---------------------------------------------------------------------------------- MMT nights

def _read_mmt(path, lines):
    """Raw night of the MMT: per star a CAT: line, then angles as elevation and azimuth.

    RAA is the refracted place of the catalogue star (0.3" from one computed with ERFA for the
    coordinates and the sidereal time of the record), AA the same with the telescope's own
    pointing model, TAA the angles of the mount with the star centred, ABS_AA the absolute
    encoder. All azimuths are from north through east, those of the mount with its cable wrap.
    """
    starts = [i for i, line in enumerate(lines) if line.startswith('CAT:')]
    wanted = {'RAA': ('az', 'el'), 'TAA': ('az_enc', 'el_enc'), 'ABS_AA': ('az_abs', 'el_abs')}
    values = {name: [] for pair in wanted.values() for name in pair}
    stars, magnitudes, sidereal, texts = [], [], [], []
    for start, stop in zip(starts, [*starts[1:], len(lines)]):
        fields = {}
        for line in lines[start:stop]:
            tag, _, rest = line.partition(':')
            fields[tag.strip()] = rest.split()
        for tag, (az, el) in wanted.items():
            cells = fields.get(tag, [])
            if len(cells) != 2 or not all(map(_is_number, cells)):
                raise ValueError(f'{path}, row {start + 1}: the record of this star has no '
                                 f'"{tag}:" with elevation and azimuth')
            values[el].append(float(cells[0]))
            values[az].append(float(cells[1]))
        catalogue = fields['CAT']
        stars.append(catalogue[0] if catalogue else '')
        magnitude = catalogue[5] if len(catalogue) > 5 else ''
        magnitudes.append(float(magnitude) if _is_number(magnitude) else np.nan)
        clock = (fields.get('LST') or [''])[0].split(':')
        good = len(clock) == 3 and all(map(_is_number, clock))
        sidereal.append(
            sum(float(c) / 60.0**i for i, c in enumerate(clock)) if good else np.nan)
        texts.append('\n'.join(lines[start:stop]))
    columns = {name: np.array(v) for name, v in values.items()}
    columns['star'] = np.array(stars)
    columns['magnitude'] = np.array(magnitudes)
    columns['lst_h'] = np.unwrap(np.array(sidereal), period=24.0)
    notes = ['az, el are RAA (refracted place), az_enc, el_enc TAA (mount with the star '
             'centred), az_abs, el_abs ABS_AA; lst_h is the local sidereal time in hours']
    return columns, _Rows(np.array(starts) + 1, texts), {'format': 'mmt', 'notes': notes}


# ------------------------------------------------------------------------------------- checks

def _swap_encoders(path, columns, meta):
    if 'az_abs' not in columns or 'el_abs' not in columns:
        raise ValueError(f'{path} has no second encoder')
    for axis in ('az', 'el'):
        first = columns.pop(f'{axis}_enc', None)
        columns[f'{axis}_enc'] = columns.pop(f'{axis}_abs')
        if first is not None:
            columns[f'{axis}_abs'] = first
    meta['notes'].append('the second (absolute) encoder was read in place of the first')


def _compare_site(site, meta):
    mine = getattr(site, 'latitude', None)
    theirs = (meta.get('site') or {}).get('latitude')
    if mine is not None and theirs is not None and abs(mine - theirs) > 0.01 * DEG:
        meta['notes'].append(f'the file says latitude {theirs / DEG:.4f} deg, it was read with '
                             f'{mine / DEG:.4f} deg')


def _refuse_radians(path, columns):
    for pair in _PAIRS:
        if pair[0] not in columns:
            continue
        values = np.concatenate([columns[name] for name in pair])
        values = values[np.isfinite(values)]
        if values.size and np.all(np.abs(values) <= 2.0 * np.pi):
            names = ', '.join(COLUMNS[name][0] for name in pair)
            raise ValueError(f'{path}: {names} never exceed {np.abs(values).max():.3g}: they '
                             'look like radians; give degrees')


def _from_south(columns):
    """Azimuth 0 south, 90 east to 0 north, 90 east: the sense of azimuth turns round."""
    for name in ('az', 'az_enc', 'az_abs'):
        if name in columns:
            columns[name] = np.pi - columns[name]
    for name in ('az_rate', 'approach_az', 'miss_x'):
        if name in columns:
            columns[name] = -columns[name]


def _sound_rows(path, columns, rows, meta):
    """Mask of the rows to keep; the others go to ``meta['excluded']`` with the reason."""
    n = len(rows.numbers)
    reason = np.zeros(n, dtype=object)  # 0: keep

    def exclude(mask, text):
        reason[mask & (reason == 0)] = text

    for name, values in columns.items():
        label = COLUMNS[name][0] if name in COLUMNS else name
        if values.dtype.kind != 'f':
            continue
        if name in REQUIRED:
            exclude(np.isnan(values), f'{label} is not a number')
        exclude(np.isinf(values), f'{label} is infinite')
        if name in ('sigma_x', 'sigma_y'):
            exclude(~(values > 0.0), f'{label} is not positive')
        missing = int(np.isnan(values).sum())
        if missing and name not in REQUIRED and not name.startswith('sigma'):
            meta['notes'].append(f'{label} is empty in {missing} of {n} rows')
    low, high = ELEVATION_LIMITS
    with np.errstate(invalid='ignore'):
        outside = (columns['el'] < low * DEG) | (columns['el'] > high * DEG)
    exclude(outside, f'elevation outside {low:g}..{high:g} deg')
    first = {}
    copy_of = [first.setdefault(text, number)
               for text, number in zip(rows.texts, rows.numbers.tolist())]
    for i in np.flatnonzero(np.array(copy_of) != rows.numbers):
        if reason[i] == 0:
            reason[i] = f'the same as row {copy_of[i]}'
    keep = reason == 0
    meta['excluded'] = [
        {'row': int(rows.numbers[i]), 'reason': reason[i]} for i in np.flatnonzero(~keep)]
    if not keep.any():
        one = meta['excluded'][0]
        raise ValueError(f'{path}: none of {n} rows can be used (row {one["row"]}: '
                         f'{one["reason"]})')
    return keep


def _derive_approach(run):
    """Approach directions, where they are missing, from the order of the rows."""
    derived = []
    for axis in ('az', 'el'):
        name = f'approach_{axis}'
        if name in run:
            continue
        motion = np.zeros(len(run))
        # the shortest way round: the file does not tell a detour
        motion[1:] = np.sign(wrap(np.diff(run[f'{axis}_enc'])))
        if 'run' in run:
            motion[1:][run['run'][1:] != run['run'][:-1]] = 0.0
        run.columns[name] = motion
        derived.append(name)
    if derived:
        run.meta['notes'].append(
            f'{", ".join(derived)} derived from the order of the rows, shortest way')


# ------------------------------------------------------------------------------------- writing

def iso_utc(seconds):
    """Times as ISO 8601 UTC to the nanosecond: enough for the same float64 when read again.

    Parameters
    ----------
    seconds : ndarray, shape (n,)
        UTC, seconds since 1970; NaN gives an empty text.

    Returns
    -------
    list of str
    """
    known = np.isfinite(seconds)
    whole = np.floor(np.where(known, seconds, 0.0))
    nanoseconds = np.rint((np.where(known, seconds, 0.0) - whole) * 1e9).astype(np.int64)
    stamps = whole.astype(np.int64).astype('datetime64[s]') \
        + nanoseconds.astype('timedelta64[ns]')
    texts = np.datetime_as_string(stamps, unit='ns')
    return [text + 'Z' if ok else '' for text, ok in zip(texts.tolist(), known.tolist())]


def write_csv(run, path):
    """Write a run as CSV that `read_run` gives back to better than 1e-9 arcsec.

    Parameters
    ----------
    run : PointingRun
    path : str or Path
        Written anew.

    Raises
    ------
    OSError
        The file cannot be written.

    Notes
    -----
    Columns in the order of `COLUMNS`, then the user's own; numbers with all their digits;
    unknown (NaN) is an empty cell; time is ISO 8601 UTC. ``meta`` is not written.
    """
    names = [name for name in COLUMNS if name in run]
    names += [name for name in run.columns if name not in COLUMNS]
    header, table = [], []
    for name in names:
        values = run[name]
        csv_name, unit, _ = COLUMNS.get(name, (name, 1.0, ''))
        header.append(csv_name)
        if name == 'time':
            table.append(iso_utc(np.asarray(values, dtype=float)))
        elif values.dtype.kind in 'fc':
            values = values if unit == 1.0 else values / unit
            table.append(['' if v != v else repr(v) for v in values.tolist()])
        else:
            table.append(values.tolist())
    with open(path, 'w', newline='', encoding='utf-8') as stream:
        writer = csv.writer(stream, lineterminator='\n')
        writer.writerow(header)
        writer.writerows(zip(*table))
