"""Numbers in the columns of tables of fixed width, from their bytes."""

import numpy as np

_SPACE, _POINT, _PLUS, _MINUS, _ZERO, _NINE = b' .+-09'
#: digits of which a double holds every number
_DIGITS = 15


def fixed_width(lines, first, last):
    """Numbers in the bytes `first` to `last`, counted from 1, of each row of `lines`.

    Parameters
    ----------
    lines : ndarray of uint8, shape (n, width)
    first, last : int

    Returns
    -------
    ndarray, shape (n,)

    Raises
    ------
    ValueError
        One of them is no number.
    """
    text = np.ascontiguousarray(lines[:, first - 1 : last])
    quick = _of_digits(np.ascontiguousarray(text.T))
    return text.view(f'S{text.shape[1]}')[:, 0].astype(float) if quick is None else quick


def _of_digits(columns):
    """The same by arithmetic on whole columns, a tenth of the time; None where it does not apply.

    With the point of all rows in one column a number is digits / 10^k: both are exact, and the
    quotient is rounded once, as whoever reads the text does.
    """
    if not columns.size or len(columns) > _DIGITS:
        return None
    value = np.zeros(columns.shape[1])
    minus = np.zeros(columns.shape[1], bool)
    begun, seen = minus.copy(), minus.copy()  # digits or the point; digits
    after = None
    for column in columns:
        if (column == _POINT).all() and after is None:
            after, begun = 0, np.ones_like(begun)
            continue
        digit = (column >= _ZERO) & (column <= _NINE)
        if not digit.all():
            sign = (column == _MINUS) | (column == _PLUS)
            # blanks, then one sign, then digits
            if np.any((begun | minus) & ~digit) or np.any(~digit & ~sign & (column != _SPACE)) or (
                    np.any(column == _PLUS)):
                return None
            minus |= column == _MINUS
        begun |= digit
        seen |= digit
        value = 10.0 * value + np.where(digit, column - np.uint8(_ZERO), 0)
        after = None if after is None else after + 1
    if not seen.all():
        return None
    return np.where(minus, -1.0, 1.0) * value / 10.0 ** (after or 0)
