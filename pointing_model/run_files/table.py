"""What the readers of pointing runs hand over, and how they take numbers from text."""

import re
from dataclasses import dataclass, field

import numpy as np

from msg_tools.units import ARCSEC, DEG
from pointing_model.mount_names import KINDS, Names
from pointing_model.mounts import ALTAZ
from pointing_model.run import COLUMNS, column_name

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
_NO_TIME = 'is neither ISO 8601 (2021-08-21T04:36:01.5Z) nor seconds since 1970'
YEAR_1900, YEAR_2100 = -2208988800.0, 4102444800.0  # s since 1970


class NoObservations(ValueError):
    """A sound file that holds no row."""


@dataclass
class Table:
    """A run as it stands in the file: every row, in the file's units and azimuth.

    Parameters
    ----------
    columns : dict of str to ndarray, shape (n,)
        By the names of `pointing_model.run.COLUMNS` and `SPECIAL`; others are drivers.
    lines : ndarray of int, shape (n,)
        Line of the file that each row begins on, from 1.
    texts : list of str or int
        What the file says in each row, or its hash: equal ones are one observation written twice.
    meta : dict
        ``format``, ``notes`` and what else the file tells.
    reasons : ndarray of object, shape (n,), optional
        Why a row is left out, 0 where it is not.
    commented : list of int
        Lines that hold an observation behind a comment sign.
    names : mounts.Names
        Of the axes, in the names of its columns.
    written : dict of str to ndarray, shape (n,)
        Angles of the axes as they stand in the file where `columns` has them on their side of the
        pole; ``beyond``: whether a column of the side of the pier places the row beyond it.
    """

    columns: dict
    lines: np.ndarray
    texts: list
    meta: dict
    reasons: np.ndarray = None
    commented: list = field(default_factory=list)
    names: Names = ALTAZ.names
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
        raise ValueError(f'{path} is a folder, not a file with a pointing run')
    data = path.read_bytes()
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
        raise ValueError(f'{path} is a binary file, not a pointing run')
    try:
        text = data.decode('utf-8-sig')
    except UnicodeDecodeError:
        text = data.decode('latin-1')
    # str.splitlines would also break at form feeds and Unicode separators
    return re.split(r'\r\n|\n|\r', text.replace('\x1a', ''))


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


def same_width(path, numbers, rows, width, what, against):
    """Refuse a row of another length than `width`; `what` its cells are, and `against` what.

    Raises
    ------
    ValueError
        With the file and the row.
    """
    for number, row in zip(numbers, rows):
        if len(row) != width:
            raise ValueError(f'{path}, row {number}: {len(row)} {what}, but {against}')


def floats(path, lines, label, cells):
    """Cells as numbers; an empty one is NaN.

    Raises
    ------
    ValueError
        A cell is no number: file, row and column `label`.
    """
    try:
        return np.array([cell or 'nan' for cell in cells], dtype=float)
    except ValueError:
        bad = next((i for i, cell in enumerate(cells) if cell and not is_number(cell)), 0)
        raise bad_cell(path, lines, label, cells, bad, _no_number(cells[bad])) from None


def _no_number(cell):
    """What is said of a cell that should be a number."""
    if re.fullmatch(r'[-+]?\d+[ :hd°]\s*\d+.*', cell):
        return 'is not a number; write decimal degrees, as 45.5'
    if re.fullmatch(r'[-+]?[\d.]+\s*\D+', cell):
        return 'is not a number; leave the unit out: the name of the column has it'
    if cell.lower() in ('n/a', 'na', '-', '--', 'none', 'null', '?'):
        return 'is not a number; leave the cell empty where nothing is known'
    return 'is not a number'


def parse_iso(path, lines, label, cells):
    """Seconds since 1970 of ISO 8601 times, UTC where no zone is given; empty is NaN.

    Raises
    ------
    ValueError
        A cell is no such time, or outside 1900 to 2100.
    """
    if len(cells) > _BLOCK:  # what a pattern matched is ten times as long as the number
        return np.concatenate([parse_iso(path, lines[i:i + _BLOCK], label, cells[i:i + _BLOCK])
                               for i in range(0, len(cells), _BLOCK)])
    matches = [_ISO.fullmatch(cell) for cell in cells]
    for i, (match, cell) in enumerate(zip(matches, cells)):
        if cell and match is None:
            raise bad_cell(path, lines, label, cells, i, _NO_TIME)
    plain = [f'{m[1]}T{m[2] or "00:00:00"}' if m else 'NaT' for m in matches]
    try:
        stamps = np.array(plain, dtype='datetime64[s]')
    except ValueError:
        for i, text in enumerate(plain):
            try:
                np.datetime64(text, 's')
            except ValueError:
                raise bad_cell(path, lines, label, cells, i, _NO_TIME) from None
        raise
    rest = np.array([float(m[3] or 0.0) - _zone(m) if m else np.nan for m in matches])
    seconds = np.where(np.isnat(stamps), 0, stamps.astype(np.int64)) + rest
    outside = (seconds < YEAR_1900) | (seconds > YEAR_2100)
    if outside.any():
        raise bad_cell(path, lines, label, cells, int(np.argmax(outside)),
                       'is outside 1900 to 2100')
    return seconds


_ISO = re.compile(r'(\d{4}-\d\d-\d\d)(?:[T ](\d\d:\d\d(?::\d\d)?)(\.\d+)?'
                  r'(?:Z|([+-])(\d\d):?(\d\d)?)?)?', re.ASCII)


def _zone(match):
    sign, hours, minutes = match[4], match[5], match[6]
    if not sign:
        return 0
    return int(sign + '1') * (int(hours) * 3600 + int(minutes or 0) * 60)
