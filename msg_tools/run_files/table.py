"""What the readers of pointing runs hand over, and how they take numbers from text."""

import re
from dataclasses import dataclass, field

import numpy as np

#: what a file may give in place of `az, el` and of the encoder's angles, in file units
SPECIAL = {'ra': 'ra_deg', 'dec': 'dec_deg', 'x': 'x_arcsec', 'y': 'y_arcsec'}


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
    texts : list of str
        What the file says in each row: equal texts are one observation written twice.
    meta : dict
        ``format``, ``notes`` and what else the file tells.
    reasons : ndarray of object, shape (n,), optional
        Why a row is left out, 0 where it is not.
    commented : list of int
        Lines that hold an observation behind a comment sign.
    """

    columns: dict
    lines: np.ndarray
    texts: list
    meta: dict
    reasons: np.ndarray = None
    commented: list = field(default_factory=list)

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


def is_number(text):
    """Whether `text` reads as a number (NaN and infinities do)."""
    try:
        float(text)
    except ValueError:
        return False
    return True


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
        raise ValueError(f'{path}, row {lines[bad]}, column {label}: '
                         f'{cells[bad][:40]!r} is not a number') from None


def parse_iso(path, lines, label, cells):
    """Seconds since 1970 of ISO 8601 times, UTC where no zone is given; empty is NaN.

    Raises
    ------
    ValueError
        A cell is no such time, or outside 1900 to 2100.
    """
    matches = [_ISO.fullmatch(cell) for cell in cells]
    for i, (match, cell) in enumerate(zip(matches, cells)):
        if cell and match is None:
            _bad_time(path, lines[i], label, cell)
    plain = [f'{m[1]}T{m[2] or "00:00:00"}' if m else 'NaT' for m in matches]
    try:
        stamps = np.array(plain, dtype='datetime64[s]')
    except ValueError:
        for i, text in enumerate(plain):
            try:
                np.datetime64(text, 's')
            except ValueError:
                _bad_time(path, lines[i], label, cells[i])
        raise
    rest = np.array([float(m[3] or 0.0) - _zone(m) if m else np.nan for m in matches])
    seconds = np.where(np.isnat(stamps), 0, stamps.astype(np.int64)) + rest
    outside = (seconds < -2208988800.0) | (seconds > 4102444800.0)
    if outside.any():
        i = int(np.argmax(outside))
        raise ValueError(f'{path}, row {lines[i]}, column {label}: {cells[i][:40]!r} is outside '
                         '1900 to 2100')
    return seconds


_ISO = re.compile(r'(\d{4}-\d\d-\d\d)(?:[T ](\d\d:\d\d(?::\d\d)?)(\.\d+)?'
                  r'(?:Z|([+-])(\d\d):?(\d\d)?)?)?', re.ASCII)


def _zone(match):
    sign, hours, minutes = match[4], match[5], match[6]
    if not sign:
        return 0
    return int(sign + '1') * (int(hours) * 3600 + int(minutes or 0) * 60)


def _bad_time(path, line, label, cell):
    raise ValueError(f'{path}, row {line}, column {label}: {cell[:40]!r} is neither ISO 8601 '
                     '(2021-08-21T04:36:01.5Z) nor seconds since 1970') from None
