"""Which rows a fit may see, and which are there to judge it by."""

from typing import NamedTuple

import numpy as np

from msg_tools.units import all_finite, wrap
from pointing_model.mounts import told
from pointing_model.run import PointingRun
from pointing_model.zero import NO_ZERO
from pointing_model.zero_exposures import MARK, is_for_zero, is_marked

from .distrust import distrusted

#: why a row is left out that no encoder angles belong to
UNREACHABLE = 'the model cannot point there'


def is_kept_out(rows):
    """Mask of the rows to judge by: those whose column ``check`` is not 0.

    The observer marks a row when it takes it, so that nothing has to be guessed from the plan.

    Parameters
    ----------
    rows : PointingRun

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    return np.asarray(rows.get('check', 0.0), dtype=float) != 0.0


def for_fitting(rows):
    """The rows that fits and choices may see: no satellites, nothing kept out, no lies.

    Parameters
    ----------
    rows : PointingRun
        With column `star`; negative: a satellite, which is for checks only. In the order in which
        they were taken: what an instrument falsified is left out, see `distrust`.
    """
    return rows.select((rows['star'] >= 0) & ~is_kept_out(rows) & ~distrusted(rows))


def by_run(rows):
    """Rows of each power-on, dict of float to PointingRun, in ascending order of the numbers."""
    order = np.argsort(rows['run'], kind='stable')
    numbers, first = np.unique(rows['run'][order], return_index=True)
    return {float(number): rows.select(part)
            for number, part in zip(numbers, np.split(order, first[1:]))}


def zero_exposures_by_run(rows):
    """Number and exposures for a zero, a PointingRun, of each power-on with some; no lies."""
    for number, part in by_run(rows.select(is_for_zero(rows) & ~distrusted(rows))).items():
        yield int(number), part


def counts(rows):
    """Numbers of stars and exposures for zeros: ``stars``, ``polaris``, and ``for_zero`` if any."""
    marked = int(np.count_nonzero(is_marked(rows)))
    stars = int(np.count_nonzero(~is_for_zero(rows)))
    out = {'stars': stars, 'polaris': len(rows) - stars - marked}
    return {**out, 'for_zero': marked} if marked else out


def with_marks(rows):
    """The rows with the columns of marks: joined with others, they must not take theirs away."""
    missing = [name for name in ('check', MARK) if name not in rows]
    if not missing:
        return rows
    return PointingRun({**rows.columns, **{name: np.zeros(len(rows)) for name in missing}},
                       rows.meta)


class Usable(NamedTuple):
    """Rows that a fit can use, and why it cannot use the others (see `usable`).

    Attributes
    ----------
    rows : ndarray of int, shape (m,)
        Their places in the run.
    az, el, az_enc, el_enc : ndarray, shape (m,)
        Catalogue place, and encoder angles without their zero, radians.
    sigmas : ndarray, shape (2m,), or None
        1-sigma noise of x, then y, radians.
    excluded : list of dict
        ``row`` and ``reason`` of the others.
    """

    rows: np.ndarray
    az: np.ndarray
    el: np.ndarray
    az_enc: np.ndarray
    el_enc: np.ndarray
    sigmas: np.ndarray | None
    excluded: list

    def only(self, good, reason):
        """Those where `good`, shape (m,), holds; the others are excluded with the reason."""
        if good.all():
            return self
        lost = [{'row': int(i), 'reason': reason} for i in self.rows[~good]]
        sigmas = None if self.sigmas is None else self.sigmas[np.concatenate((good, good))]
        return Usable(*(v[good] for v in self[:5]), sigmas,
                      sorted(self.excluded + lost, key=lambda e: e['row']))


def usable(run, encoder='enc', zero=NO_ZERO):
    """Finite rows with their sigmas.

    Parameters
    ----------
    run : PointingRun
        ``sigma_x`` and ``sigma_y`` are taken if both are there and not all unknown.
    encoder : {'enc', 'abs'}
    zero : RunZero or Zeros
        To subtract from the encoder's angles.

    Returns
    -------
    Usable

    Raises
    ------
    ValueError
        Unknown encoder, or the run does not have it; a run without a zero.
    """
    if encoder not in ('enc', 'abs'):
        raise ValueError(f'unknown encoder {encoder!r}; take enc or abs')
    for name in (f'az_{encoder}', f'el_{encoder}'):
        if name not in run:
            raise ValueError(f'pointing run without column {name}; fit the other encoder')
    columns = {name: np.asarray(run[name], float)
               for name in ('az', 'el', f'az_{encoder}', f'el_{encoder}')}
    for name, angle in zip((f'az_{encoder}', f'el_{encoder}'), zero.of_rows(run)):
        if np.ndim(angle) or angle:
            columns[name] = columns[name] - angle
    if not run.mount.altaz:  # either side of the half turn
        columns[f'el_{encoder}'] = columns['el'] + wrap(columns[f'el_{encoder}'] - columns['el'])
    sigmas = None
    if 'sigma_x' in run and 'sigma_y' in run:
        sigmas = [np.asarray(run[name], float) for name in ('sigma_x', 'sigma_y')]
        if all(np.isnan(s).all() for s in sigmas):
            sigmas = None
    good = np.ones(len(run), bool)
    for value in columns.values():
        if not all_finite(value):
            good &= np.isfinite(value)
    for value in sigmas or ():
        good &= np.isfinite(value) & (value > 0.0)
    excluded = []
    kept = np.flatnonzero(good)
    for row in np.flatnonzero(~good) if len(kept) < len(good) else ():
        bad = [name for name, v in columns.items() if not np.isfinite(v[row])]
        reason = f'{", ".join(bad)} not finite' if bad else 'sigma not finite and positive'
        excluded.append({'row': int(row), 'reason': reason})
    keep = good if excluded else slice(None)
    if sigmas is not None:
        sigmas = np.concatenate([s[keep] for s in sigmas])
    return Usable(kept, *(v[keep] for v in columns.values()), sigmas, excluded)


def check_mount(mount, others):
    """ValueError where observations are of another mount than what they are to go with.

    Parameters
    ----------
    mount : Mount
    others : dict of str to (Mount or None)
        By what they are of, in words; None: not known.
    """
    for what, other in others.items():
        if other is not None and not mount.agrees(other):
            raise ValueError(f'an observation of another mount ({told(mount)}) than {what} '
                             f'({told(other)})')
