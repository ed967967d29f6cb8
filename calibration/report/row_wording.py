"""Words for rows: how many were used, which were left out, and why."""

from pathlib import PurePath

import numpy as np

_NAMED = 5  # outliers in a sentence, at most
_REASONS = 12  # lines of rows left out, at most


def used_sentence(told):
    """First line of what people read.

    Parameters
    ----------
    told : dict
        With ``rows_used``, ``rows_read``, ``rows_taken_back``.

    Returns
    -------
    str
    """
    more = told.get('rows_taken_back')
    return f'{told["rows_used"]} of {told["rows_read"]} rows used' + (
        f'; {more} more {"is" if more == 1 else "are"} commented out or rejected in the file'
        if more else '')


def expected_sentence(document):
    """The error to be expected of the model, from a document with ``expected``; None if unknown."""
    told = document.get('expected')
    if not told:
        return None
    return (f'expected on fresh stars in the {told.get("within", "half hour")} after: '
            f'{told["rms_arcsec"]:.2f} arcsec radial, {told["low_arcsec"]:.2f} to '
            f'{told["high_arcsec"]:.2f} in {100 * told["confidence"]:.0f} % of cases')


def outlier_sentence(document):
    """Which rows are outliers, and what they do to the RMS; empty where there is none.

    Parameters
    ----------
    document : dict
        With ``outliers``, ``rms_with_outliers_arcsec``, ``after`` and ``rows_are``.

    Returns
    -------
    str
    """
    rows = document.get('outliers') or []
    if not rows:
        return ''
    word = document.get('rows_are') or 'row'
    named = ', '.join(
        (f'{row["source"]} ' if 'source' in row else '')
        + f'{word} {row["row"]} ({_star(row)}'
        f'{far_text(np.hypot(row["x_arcsec"], row["y_arcsec"]))} off)'
        for row in rows[:_NAMED])
    more = f' and {len(rows) - _NAMED} more' if len(rows) > _NAMED else ''
    what = 'An outlier' if len(rows) == 1 else f'{len(rows)} outliers'
    return (f'{what}, left out: {named}{more}. RMS without {document["after"]["rms_arcsec"]:.2f} '
            f'arcsec, RMS with {"it" if len(rows) == 1 else "them"} '
            f'{document["rms_with_outliers_arcsec"]:.1f} arcsec.')


def _star(row):
    return f'star {row["star"]}, ' if 'star' in row else ''


def far_text(arcsec):
    """An amount of error in words."""
    return f'{arcsec:.0f} arcsec' if arcsec < 3600.0 else f'{arcsec / 3600.0:.2f} deg'


def left_out_lines(excluded, several=False, word='row'):
    """Which rows are left out and why: a line for each reason.

    Parameters
    ----------
    excluded : list of dict
        ``row`` (the line in the file), ``reason``, ``source``.
    several : bool
        Whether there are several files: the line says which.
    word : str
        As of `RowCounts`.

    Returns
    -------
    list of str
    """
    reasons = {}
    for one in excluded:
        source = PurePath(str(one['source'])).name if several and one.get('source') else ''
        reasons.setdefault((source, one['reason']), []).append(one['row'])
    lines = [f'{source}{": " if source else ""}{word}{"s" * (len(rows) > 1)} {listed(rows)} '
             f'left out: {reason}' for (source, reason), rows in reasons.items()]
    if len(lines) <= _REASONS:
        return lines
    others = list(reasons.values())[_REASONS:]
    return [*lines[:_REASONS], f'{sum(map(len, others))} {word}s more left out, for {len(others)} '
            'other reasons (--json FILE has them all)']


def listed(rows, limit=10):
    """Numbers as text, neighbours as a range: 3, 7-9; of many the first and how many."""
    rows = sorted(set(rows))
    breaks = [i for i, (a, b) in enumerate(zip(rows, rows[1:]), 1) if b != a + 1]
    parts = [rows[i:j] for i, j in zip([0, *breaks], [*breaks, len(rows)])]
    texts = [f'{p[0]}' if len(p) == 1 else f'{p[0]}-{p[-1]}' for p in parts]
    more = f', ... ({len(rows)} rows)' if len(texts) > limit else ''
    return ', '.join(texts[:limit]) + more


def columns_alike(readings):
    """What is said of readings of the columns that fit as well."""
    return ('read otherwise the columns fit as well, so make sure that they are not: '
            + '; '.join(readings))


def _reading_as_good(found):
    zero, tilt = found['sizes_deg']
    own_zero, own_tilt = found['as_written_deg']
    return (f'{found["where"]}{found.causes[0]} would fit as well, with a zero of {zero:.3g} deg '
            f'and a tilt of {tilt:.3g} in place of a zero of {own_zero:.3g} deg and a tilt of '
            f'{own_tilt:.3g}: make sure of the {found["what"]}')


def _better_reading(found):
    return (f'{found["where"]}{found.causes[0]} would fit to {found.after:.1f} arcsec, where the '
            f'seven terms leave {found.before:.1f}; an effect that they lack may do so too: make '
            f'sure of the {found["what"]}')


#: kind of a `Finding` -> its sentence
KINDS = {
    'columns alike': lambda found: columns_alike(found.causes),
    'reading as good': _reading_as_good,
    'better reading': _better_reading,
}
