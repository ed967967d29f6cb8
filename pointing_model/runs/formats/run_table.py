"""What the readers of pointing runs hand over, and how they take numbers from text."""

import re
from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from msg_tools.iso_time import read_iso
from msg_tools.units import ARCSEC, DEG
from pointing_model.mount_kinds import KINDS, MountKind
from pointing_model.mounts import ALTAZ
from pointing_model.runs.run import COLUMNS, column_name

#: what a file may give in place of `az, el` and of the encoder's angles, and its unit in SI;
#: kept under the file's name, which no column of the user's own can have
SPECIAL = {'ra_deg': DEG, 'dec_deg': DEG, 'ra_enc_deg': DEG, 'x_arcsec': ARCSEC,
           'y_arcsec': ARCSEC, 'lst_told': DEG}
#: what a diagnosis makes itself: see `pointing_model.context.Context`
DERIVED = frozenset((
    'azimuth', 'elevation', 'row', 'ra', 'dec', 'lst', 'order', 'pm_x', 'pm_y', 'reading_az',
    'reading_el', 'travel_az', 'travel_el', 'before_az', 'before_el', 'run_hours', 'counterweight',
    *(key for kind in KINDS.values() for key in kind.keys)))
_HOURS_OF_A_DAY = 24.0
_RADIANS = 6.3  # a little more than a turn
_BLOCK = 5000  # times that are read together
#: cells that say that nothing is known
UNKNOWN = ('', 'n/a', 'na', '-', '--', 'none', 'null', '?', 'unknown')
_POINT = re.compile(r'[-+]?\d*\.\d+(?:[eE][-+]?\d+)?', re.ASCII)
_COMMA = re.compile(r'[-+]?\d*,\d+(?:[eE][-+]?\d+)?', re.ASCII)
_NO_TIME = 'is neither ISO 8601 (2021-08-21T04:36:01.5Z) nor seconds since 1970'
YEAR_1900, YEAR_2100 = -2208988800.0, 4102444800.0  # s since 1970
CLOCK = 1e8  # s: below, time counts from an arbitrary start


class NoObservations(ValueError):
    """A sound file that holds no row."""


@dataclass
class Table:
    """A run as it stands in the file: every row, in the file's units and azimuth.

    Parameters
    ----------
    columns : dict of str to ndarray, shape (n,)
        By the names of `pointing_model.runs.run.COLUMNS` and `SPECIAL`; others are drivers.
    lines : ndarray of int, shape (n,)
        Line of the file that each row begins on, from 1.
    meta : dict
        ``format``, ``notes`` and what else the file tells.
    reasons : ndarray of object, shape (n,), optional
        Why a row is left out, 0 where it is not.
    commented : list of int
        Lines that hold an observation behind a comment sign.
    names : MountKind
        Of the axes, in the names of its columns.
    written : dict of str to ndarray, shape (n,)
        Angles of the axes as they stand in the file where `columns` has them on their side of the
        pole; ``beyond``: whether a column of the side of the pier places the row beyond it.
    """

    columns: dict
    lines: np.ndarray
    meta: dict
    reasons: np.ndarray = None
    commented: list = field(default_factory=list)
    names: MountKind = ALTAZ.names
    written: dict = field(default_factory=dict)

    def label(self, name):
        """Name of a column in the file."""
        return column_name(name, self.names)

    def __post_init__(self):
        if self.reasons is None:
            self.reasons = np.zeros(len(self.lines), dtype=object)

    def exclude(self, mask, text):
        """Leave out the rows of `mask`; the first reason counts."""
        self.reasons[mask & (self.reasons == 0)] = text


def read_lines(path):
    """Lines of a text file, numbered as an editor does.

    Raises
    ------
    ValueError
        A folder, an MCAP log, empty, or binary.
    OSError
        The file cannot be read.
    """
    if path.is_dir():
        raise ValueError(f'{path} is a folder, not a file with a table')
    return lines_of(path, path.read_bytes())


def lines_of(path, data):
    """Lines of the bytes of a text file, as `read_lines`; `path` for messages."""
    if data.startswith(b'\x89MCAP'):
        raise ValueError(f'{path} is an MCAP log, not a table of observations')
    if not data.strip():
        raise ValueError(f'{path} is empty')
    if data.startswith((b'\xff\xfe', b'\xfe\xff')):  # what some spreadsheets call Unicode text
        try:
            data = data.decode('utf-16').encode()
        except UnicodeDecodeError:
            raise ValueError(f'{path} is UTF-16 and breaks off; save it as CSV in UTF-8') from None
    if data.startswith((b'PK\x03\x04', b'\xd0\xcf\x11\xe0')):
        raise ValueError(f'{path} is a workbook of a spreadsheet or an archive: save the table as '
                         'CSV and give that')
    # control characters other than tab, newline, form feed, carriage return, DOS end of file
    if re.search(rb'[\x00-\x08\x0b\x0e-\x19\x1b-\x1f]', data):
        raise ValueError(f'{path} is a binary file, not a table')
    try:
        text = data.decode('utf-8-sig')
    except UnicodeDecodeError:
        text = data.decode('latin-1')
    # str.splitlines would also break at form feeds and Unicode separators
    lines = re.split(r'\r\n|\n|\r', text.replace('\x1a', ''))
    if re.fullmatch(r'"?sep=[,;\t]"?', lines[0].strip(' ')):  # for one program of spreadsheets
        lines[0] = ''
    return lines


def content(lines, comment='#'):
    """(line number, text) of lines that are neither blank nor comments."""
    return [(number, line) for number, line in enumerate(lines, 1)
            if line.strip() and not line.lstrip().startswith(comment)]


def own_name(name, taken, notes):
    """Name under which a column of the user's own is kept.

    Parameters
    ----------
    name : str
        In the file.
    taken : collection of str
        All names in the file.
    notes : list of str
        Told here if another name is needed.

    Returns
    -------
    str
    """
    if name not in DERIVED and name not in COLUMNS and name not in SPECIAL:
        return name
    new = f'column_{name}'
    while new in taken:
        new = f'column_{new}'
    notes.append(f'column {name!r} is kept as {new!r}: {name} is a name with a meaning of its own')
    return new


def sidereal_name(values, taken, notes):
    """Name under which a column ``lst`` is kept, by its unit.

    Parameters
    ----------
    values : ndarray, shape (n,)
    taken : collection of str
        All names in the file.
    notes : list of str
        Told here what was taken for what.

    Returns
    -------
    str
    """
    known = values[np.isfinite(values)]
    low, high = (known.min(), known.max()) if known.size else (0.0, 0.0)
    if 'lst_h' in taken or low < -_RADIANS or high > _HOURS_OF_A_DAY or (
            low < 0.0 and high > _RADIANS):
        notes.append('lst_h is the name of the sidereal time, in hours')
        return own_name('lst', taken, notes)
    if high > _RADIANS:
        notes.append(f"column 'lst' goes to {high:.4g}: taken as hours, kept as lst_h")
        return 'lst_h'
    notes.append(f"column 'lst' never exceeds {_RADIANS}: taken as radians; call it lst_h if it is "
                 'in hours')
    return 'lst'


def is_number(text):
    """Whether `text` reads as a number (NaN and infinities do)."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def bad_cell(path, lines, label, cells, i, what):
    """The ValueError of the cell of row `i`, which `what` is said of."""
    return ValueError(f'{path}, row {lines[i]}, column {label}: {cells[i][:40]!r} {what}')


def same_width(path, numbers, rows, width, what, against, reasons=None):
    """Blank rows of another length than `width`; `what` their cells are, and `against` what.

    Parameters
    ----------
    reasons : ndarray of object, shape (n,), optional
        Gets why a row is left out; without it, and where most rows are such, the file is refused.

    Raises
    ------
    ValueError
        With the file and the row.
    """
    bad = [i for i, row in enumerate(rows) if len(row) != width]
    if bad and (reasons is None or 2 * len(bad) > len(rows)):
        i = bad[0]
        raise ValueError(f'{path}, row {numbers[i]}: {len(rows[i])} {what}, but {against}')
    for i in bad:
        reasons[i] = f'{len(rows[i])} {what}, but {against}'
        rows[i] = [''] * width


def usual_width(body):
    """Words of most lines of (line number, text), but for those that begin with ``#``."""
    lines = [line for _, line in body if not line.startswith('#')] or [line.lstrip('# ')
                                                                       for _, line in body]
    return Counter(len(line.split()) for line in lines).most_common(1)[0][0]


def cost_rows(path, lines, label, cells, bad, reasons=None):
    """Leave out the rows of bad cells; a column most of whose cells are bad costs the file.

    Parameters
    ----------
    path : Path
    lines : sequence of int, shape (n,)
    label : str
        Name of the column.
    cells : sequence of str, shape (n,)
    bad : dict of int to str
        Rows, and what is said of their cells.
    reasons : ndarray of object, shape (n,), optional
        Gets why a row is left out; without it one bad cell costs the file.

    Raises
    ------
    ValueError
        File, row and column.
    """
    if not bad:
        return
    if reasons is None or 2 * len(bad) > sum(map(bool, cells)):
        i = min(bad)
        raise bad_cell(path, lines, label, cells, i, bad[i])
    for i, what in bad.items():
        if reasons[i] == 0:
            reasons[i] = f'{label} {cells[i][:40]!r} {what}'


def decimal_points(cells):
    """Numbers with decimal commas as ones with points, where none of the column has a point."""
    if not any(',' in cell for cell in cells) or any(map(_POINT.fullmatch, cells)):
        return cells
    return [cell.replace(',', '.') if _COMMA.fullmatch(cell) else cell for cell in cells]


def floats(path, lines, label, cells, reasons=None):
    """Cells as numbers; one that is empty, or says that it is unknown, is NaN.

    Parameters
    ----------
    path, lines, label, cells, reasons
        As of `cost_rows`.

    Returns
    -------
    ndarray, shape (n,)
        NaN where a cell is no number.

    Raises
    ------
    ValueError
        As `cost_rows`.
    """
    cells = decimal_points(cells)
    try:
        return np.array([cell or 'nan' for cell in cells], dtype=float)
    except ValueError:
        pass
    values, bad = np.full(len(cells), np.nan), {}
    for i, cell in enumerate(cells):
        if is_number(cell):
            values[i] = float(cell)
        elif cell.lower() not in UNKNOWN:
            bad[i] = _no_number(cell)
    cost_rows(path, lines, label, cells, bad, reasons)
    return values


def _no_number(cell):
    """What is said of a cell that should be a number."""
    if re.fullmatch(r'[-+]?\d+[ :hd°]\s*\d+.*', cell):
        return 'is not a number; write decimal degrees, as 45.5'
    if _COMMA.fullmatch(cell):
        return 'is not a number; other cells of the column have decimal points'
    if re.fullmatch(r'[-+]?[\d.]+\s*\D+', cell):
        return 'is not a number; leave the unit out: the name of the column has it'
    return 'is not a number'


def parse_iso(path, lines, label, cells, reasons=None):
    """Seconds since 1970 of ISO 8601 times, UTC where no zone is given; empty is NaN.

    Parameters
    ----------
    path, lines, label, cells, reasons
        As of `cost_rows`. What is read: `msg_tools.iso_time.read_iso`.

    Raises
    ------
    ValueError
        As `cost_rows`; a bad cell is no such time, or outside 1900 to 2100.
    """
    values = np.empty(len(cells))
    for i in range(0, len(cells), _BLOCK):  # what a pattern matched is ten times as long
        whole, fraction = read_iso(cells[i:i + _BLOCK])
        values[i:i + _BLOCK] = whole + fraction
    bad = {int(i): _NO_TIME for i in np.flatnonzero(np.isnan(values))
           if cells[i].lower() not in UNKNOWN}
    outside = (values < YEAR_1900) | (values > YEAR_2100)
    bad |= {int(i): 'is outside 1900 to 2100' for i in np.flatnonzero(outside)}
    cost_rows(path, lines, label, cells, bad, reasons)
    return np.where(outside, np.nan, values)


def seconds_or_iso(path, lines, label, cells, reasons=None):
    """Times that are seconds since 1970, or ISO 8601: what most cells are.

    Parameters
    ----------
    path, lines, label, cells, reasons
        As of `cost_rows`.

    Raises
    ------
    ValueError
        As `cost_rows`; half of the times are seconds, half ISO 8601.
    """
    known = [i for i, cell in enumerate(cells) if cell.lower() not in UNKNOWN]
    seconds = [i for i in known if is_number(cells[i])]
    if 2 * len(seconds) == len(known) > 0:
        other = next(i for i in known if not is_number(cells[i]))
        if not np.isnan(read_iso([cells[other]])[1][0]):
            raise ValueError(f'{path}, column {label}: mixes seconds (row {lines[seconds[0]]}) and '
                             f'ISO 8601 (row {lines[other]})')
    if 2 * len(seconds) < len(known) or not known:
        return parse_iso(path, lines, label, cells, reasons)
    values = floats(path, lines, label, cells, reasons)
    outside = np.isfinite(values) & ((values < YEAR_1900) | (values > YEAR_2100))
    cost_rows(path, lines, label, cells, {
        int(i): f'is outside 1900 to 2100{_unit_of(values[i])}; give seconds since 1970 or '
        'ISO 8601' for i in np.flatnonzero(outside)}, reasons)
    return np.where(outside, np.nan, values)


def _unit_of(value):
    """A question after a unit in which a number would be a time."""
    return next((f' (is this {word}?)' for scale, word in (
        (1e3, 'milliseconds'), (1e6, 'microseconds'), (1e9, 'nanoseconds'))
        if CLOCK < value / scale < YEAR_2100), '')
