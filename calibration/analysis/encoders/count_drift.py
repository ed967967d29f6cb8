"""Counts that wander: does incremental - absolute walk at random, and which encoder does it?

Noise of the reading leaves every difference for itself; wrong counts stay, and the next ones are
added. Both are fitted at once (a random walk and white noise, by maximum likelihood), beside what
the discs do once and twice a turn, and the walk must explain more than chance, more than one step
or one drift does, more than the side of approach (a coupling that winds up), and more than finer
harmonics of the angle. Who steps twice wanders.
"""

from typing import NamedTuple

import numpy as np

from msg_tools.units import ARCSEC, wrap
from pointing_model.context import Context
from pointing_model.effects.base import effect
from pointing_model.effects.hysteresis import MEMORIES
from pointing_model.zero_drift import AxisFollowing, Following, harmonic_columns

from ...estimation.correlated_noise import restricted
from ...estimation.group_columns import GroupColumns
from ...estimation.step_scan import robust_fit, two_sided
from .cross_check_night import SHORT, CrossCheckNight, EncoderFinding
from .cross_check_noise import colour_of, restricted_coloured
from .cross_check_records import Budget
from .encoder_jumps import jumps_of
from .jump_causes import ABSOLUTE, INCREMENTAL

#: variance of a step of the walk over that of the noise, tried
_RATIOS = np.geomspace(1e-4, 1e3, 57)
#: rows from which a walk is told from noise
_FEWEST = 20
#: rows that are tried; of more every second, third, ...: the effort grows with the cube
_MOST = 400
#: finer curves of the angle that a night in order of azimuth could take for a walk
_FINER = (3, 4, 5, 6)
#: robust sigmas from its neighbours from where a reading is wild
_WILD = 6.0
#: neighbours on a side that a reading is compared with
_BESIDE = 4
#: of the stars' voice for the incremental encoder, from where its zero follows the other
_TRUST = 0.9
#: odds that it is the incremental encoder, before the stars are asked: its errors add up, while an
#: absolute encoder reads each angle anew
_ODDS = 4.0
#: how far a disc may be off, 1 sigma of a harmonic, rad
_DISC = 10.0 * ARCSEC
#: correlation of neighbours up to which it is noise; what remembers longer is a walk
_SHORT = 0.65
#: `Walk.lead` from where a walk is sure without the stars, a hundred to one; below they have to
#: see it
_SURE = 2.0 * np.log(100.0)
_SEEN = 0.99
_CHANCE = Budget().false_alarm / 2.0  # two axes


class Walk(NamedTuple):
    """A random walk found in incremental - absolute of one axis.

    Attributes
    ----------
    probability : float
        Of so much by chance.
    step, noise : float
        1 sigma of what is added from row to row, and of a difference, rad.
    discs : ndarray, shape (4,)
        What the discs do, rad.
    path : ndarray, shape (n,)
        The walk at each row, its mean taken off, rad.
    lead : float
        Twice the logarithm of its likelihood over that of noise that soon forgets; infinite where
        no row resembles the one before.
    """

    probability: float
    step: float
    noise: float
    discs: np.ndarray
    path: np.ndarray
    lead: float = np.inf


def find_walk(apart, angle, run, rivals=(), limit=_CHANCE, least=0.0, sides=()):
    """Whether differences walk at random.

    Parameters
    ----------
    apart : ndarray, shape (n,)
        Incremental - absolute in order of time, rad.
    angle : ndarray, shape (n,)
        Of the axis, rad.
    run : ndarray, shape (n,)
        Power-on; each has a zero of its own.
    rivals : sequence of (ndarray, int)
        What explains it otherwise, together: columns, and how many numbers each costs.
    limit : float
        Chance from which on it is no walk.
    least : float
        Noise of a difference at least, rad.
    sides : sequence of ndarray, shape (n,)
        By which side the axis came: each explains it otherwise, beside the rivals.

    Returns
    -------
    Walk or None
        None where chance, the rivals, the side of approach or finer harmonics of the angle
        explain as much, and leave nothing that walks.
    """
    n = len(apart)
    if n < _FEWEST:
        return None
    members = np.stack([run == r for r in np.unique(run)], axis=1).astype(float)
    discs = harmonic_columns(angle)
    fixed = np.column_stack([members, discs])
    if n < fixed.shape[1] + 8:
        return None
    y = _tame(apart, discs, run)
    scale = max(np.std(y), least)
    walk, ratio, probability = min(
        ((kernel, *_restricted(y / scale, fixed, kernel, least / scale))
         for kernel in _kernels(angle, run)), key=lambda one: one[2])
    probability *= 2.0
    if probability >= limit:
        return None
    lead = _lead(y, fixed, run, ratio, walk, least)
    if lead <= 0.0:
        return None
    curves = np.column_stack([fixed, *(column for column, _ in rivals)])
    others = [(curves, sum(cost for _, cost in rivals)),
              (np.column_stack([curves, harmonic_columns(angle, _FINER)]), 2 * len(_FINER))]
    others += [(np.column_stack([curves, side]), others[0][1] + 1) for side in sides]
    best = _bic(y / scale, fixed, np.eye(n) + ratio * walk, 1, least / scale)
    for columns, cost in others:
        if n < columns.shape[1] + 8:
            continue
        # the better explanation, or not enough of one: what it leaves still walks
        if best >= _bic(y / scale, columns, None, cost, least / scale) \
                and _restricted(y / scale, columns, walk, least / scale)[1] >= limit:
            return None
    covariance = np.eye(n) + ratio * walk
    noise = _noise(y, fixed, covariance)
    inverse = np.linalg.inv(covariance)
    # discs of a part of the turn resemble each other: no more of them than a disc has
    narrow = np.repeat([0.0, _DISC**-2], [members.shape[1], discs.shape[1]]) * noise**2
    beta = np.linalg.lstsq(fixed.T @ inverse @ fixed + np.diag(narrow), fixed.T @ inverse @ y,
                           rcond=1e-9)[0]
    left = y - fixed @ beta
    path = ratio * walk @ inverse @ left
    return Walk(probability, float(np.sqrt(ratio) * noise), float(noise), beta[-discs.shape[1]:],
                path - members @ (members.T @ path / members.sum(axis=0)), lead)


def _kernels(angle, run):
    """What a walk of variance 1 a row makes of the rows, (n, n): two kinds.

    A step with every row, as a zero does that moves with time; and one the larger, the farther
    the axis has turned, as wrong counts make: they come with the counts.
    """
    for way in (np.ones(len(run)), np.abs(wrap(np.diff(angle, prepend=angle[:1])))):
        if way.any():
            far = np.cumsum(way / way.mean()) + 1.0
            yield np.minimum(*np.meshgrid(far, far)) * (run[:, None] == run[None, :])


def _tame(y, discs, run):
    """Readings far from those before and those after them are brought to these.

    One wild reading is no walk; where it stays, it is one.
    """
    out = robust_fit(GroupColumns.of(run, rest=discs), y).residual
    smooth = y - out
    for r in np.unique(run):
        at = np.flatnonzero(run == r)
        if len(at) < 4 * _BESIDE:
            continue
        own = out[at]
        # of the next four, for each but the last four; and the same backwards
        after = np.median(np.lib.stride_tricks.sliding_window_view(own[1:], _BESIDE), axis=1)
        before = np.median(np.lib.stride_tricks.sliding_window_view(own[:-1], _BESIDE), axis=1)
        beside = np.full((2, len(own)), np.nan)
        beside[0, :-_BESIDE], beside[1, _BESIDE:] = after, before
        off = np.abs(own - beside)
        limit = _WILD * np.maximum(1.4826 * np.nanmedian(off, axis=1), 0.02 * ARCSEC)
        wild = ((off > limit[:, None]) | np.isnan(off)).all(axis=0)
        out[at] = np.where(wild, np.nanmean(beside, axis=0), own)
    return smooth + out


def _restricted(y, fixed, walk, least):
    """Ratio of the variances by restricted likelihood, and the chance of so much without a walk.

    By its likelihood ratio, half of which are zero without a walk (Self and Liang 1987; for a
    random walk they are more, so this is on the safe side). Two variances are all there is, so one
    decomposition serves all ratios: `restricted`, in the walk's own coordinates.
    """
    q, _ = np.linalg.qr(fixed, mode='complete')
    free = q[:, np.linalg.matrix_rank(fixed):]
    values, vectors = np.linalg.eigh(free.T @ walk @ free)
    squares = np.square(vectors.T @ (free.T @ y))
    m = len(values)

    def likelihood(ratio):
        spread = 1.0 + ratio * np.maximum(values, 0.0)
        variance = max(np.sum(squares / spread) / m, least**2)
        return -m * np.log(variance) - np.sum(np.log(spread)) \
            - np.sum(squares / spread) / variance

    all_ = [likelihood(ratio) for ratio in _RATIOS]
    best = int(np.argmax(all_))
    gain = all_[best] - likelihood(0.0)
    if gain <= 0.0:
        return 0.0, 1.0
    return float(_RATIOS[best]), 0.5 * float(two_sided(np.sqrt(gain), 1e9))


def _lead(y, fixed, run, ratio, walk, least):
    """`Walk.lead`, by the restricted likelihoods of both beside the same columns."""
    short = colour_of(fixed, y, run, most=_SHORT).rho
    if not short.any():
        return np.inf
    half = np.linalg.cholesky(np.eye(len(y)) + ratio * walk)
    columns = np.linalg.solve(half, np.column_stack([fixed, y]))
    return float(restricted_coloured(fixed, y, short, least)
                 - restricted(columns, 2.0 * np.log(np.diag(half)).sum(), least)[0])


def _bic(y, fixed, covariance, more, least):
    """Bayes' information criterion of a fit with that covariance and `more` numbers."""
    n = len(y)
    left, size = _left(y, fixed, covariance)
    variance = max(left @ left / n, least**2)
    return n * np.log(variance) + left @ left / variance + size + more * np.log(n)


def _noise(y, fixed, covariance):
    left, _ = _left(y, fixed, covariance)
    return np.sqrt(left @ left / max(len(y) - fixed.shape[1], 1))


def _left(y, fixed, covariance):
    """What a fit leaves, whitened, and the logarithm of the determinant of the covariance."""
    size = 0.0
    if covariance is not None:
        half = np.linalg.cholesky(covariance)
        size = 2.0 * np.sum(np.log(np.diag(half)))
        y, fixed = np.linalg.solve(half, y), np.linalg.solve(half, fixed)
    return y - fixed @ np.linalg.lstsq(fixed, y, rcond=1e-9)[0], size


# --- of a night -----------------------------------------------------------------------------------


class Moved(NamedTuple):
    """What moved inside the power-ons of a night.

    Attributes
    ----------
    events : list of (int, Found)
        Axis, and what incremental - absolute shows.
    walks : dict of int to Walk
        By axis.
    jumps : list of Jump
        Who it was: first those of `events`, then those that only the sky shows.
    sky : Sky or None
    """

    events: list
    walks: dict
    jumps: list
    sky: object


def moved_inside(night, model, budget, notes):
    """Steps, drifts and walks inside power-ons.

    Parameters
    ----------
    night : CrossCheckNight
    model : PointingModel or None
    budget : Budget
    notes : list of str
        Gets what could not be judged.

    Returns
    -------
    Moved
    """
    events = [(axis, event) for axis in (0, 1) for event in night.apart_events(axis, budget)]
    sky = night.sky(events, model, notes)
    jumps = jumps_of(night, sky, events, budget)
    walks = {}
    for axis in (0, 1):
        own = [event for k, event in events if k == axis]
        # a step that the sky shows may be a small one of the difference
        also = [jump.column for jump in jumps[len(events):] if jump.axis == axis]
        walking = wander_of(night, axis, own, budget, also)
        if walking is not None:
            walks[axis] = walking
    while walks:
        told = [(axis, event) for axis in (0, 1) for event in (
            [walks[axis][0]] if axis in walks else [e for k, e in events if k == axis])]
        seen = night.sky(told, model, [])
        found = jumps_of(night, seen, told, budget)
        unsure = [axis for axis in walks if walks[axis][1].lead < _SURE and not any(
            jump.axis == axis and jump.event.kind == 'wander' and jump.event.confidence > _SEEN
            for jump in found)]
        if not unsure:
            return Moved(told, {axis: walk for axis, (_, walk) in walks.items()}, found, seen)
        for axis in unsure:
            del walks[axis]
    return Moved(events, {}, jumps, sky)


def wander_of(night, axis, events, budget, also=()):
    """A walk of an axis, in place of its steps and drifts.

    Parameters
    ----------
    night : CrossCheckNight
    axis : {0, 1}
    events : list of Found
        Its steps and drifts.
    budget : Budget
    also : sequence of ndarray, shape (n,)
        Steps that the stars show at a moment of their own.

    Returns
    -------
    (Found, Walk) or None
    """
    rows = np.flatnonzero(night.run >= 0.0)
    every = -(-len(rows) // _MOST) or 1
    some = rows[::every]
    rivals = []
    if len(events) <= 1:  # who steps twice wanders
        rivals = [(e.column[some], 1 if e.kind == 'drift' else 2) for e in events]
        rivals += [(column[some], 1) for column in also[:1]]
    walk = find_walk(
        night.apart[axis][some], night.rows[f'{SHORT[axis]}_enc'][some], night.stretch[some],
        rivals, budget.false_alarm / 2.0, 0.02 * ARCSEC,  # two axes
        [side[some] for side in _sides(night, axis)])
    if walk is None:
        return None
    walk = walk._replace(step=walk.step / np.sqrt(every))
    column = np.zeros(len(night.run))
    column[rows] = np.interp(rows, some, walk.path)
    size = float(np.ptp(walk.path))
    found = EncoderFinding(night.tonight[-1], 'wander', float(night.rows['time'][rows].mean()),
                  column / size, size, 0.0, 2.0 * walk.probability, _ODDS)
    return found, walk


def _sides(night, axis):
    """What a coupling that winds up, or play, does to the difference: a column for each memory."""
    context, name = Context.of_run(night.rows), SHORT[axis]
    play = [effect('hysteresis', axis=name, shape='1', memory_deg=memory)
            for memory in (0.0, *MEMORIES)]
    return [np.nan_to_num(np.broadcast_to(one.of(context)[0][axis], len(night.run)))
            for one in play if all(context.get(need) is not None for need in one.requires)]


def followed(rows, budget=None):
    """What the zero of each axis has to follow, by the rows of a night.

    Parameters
    ----------
    rows : PointingRun
        To fit by, with ``run``, ``star`` and ``time``; without a second encoder nothing follows.
    budget : Budget, optional

    Returns
    -------
    Following
        Axes of which the incremental encoder wanders, by the stars; nothing where the stars
        cannot tell which encoder it is, or say that it is the other.
    """
    if any(name not in rows for name in ('az_abs', 'el_abs', 'run', 'star', 'time')):
        return Following()
    budget = budget or Budget()
    night = CrossCheckNight(rows, None)
    if not len(night.run):
        return Following()
    found = moved_inside(night, None, budget, [])
    axes = {}
    for axis, walk in found.walks.items():
        said = next(jump.event for jump in found.jumps
                    if jump.axis == axis and jump.event.kind == 'wander')
        if said.moved == INCREMENTAL and said.confidence >= _TRUST:
            references, starts = _references(night, axis, walk)
            axes[SHORT[axis]] = AxisFollowing(
                walk.discs, references, walk.noise, walk.step, starts)
    return Following(axes)


def _references(night, axis, walk):
    """Of each power-on, and when that of the absolute encoder began.

    At Polaris where it was seen: there its zero was measured. The absolute encoder's own power-on
    may change what it reads: the newest with Polaris counts.
    """
    smooth = night.apart[axis] - harmonic_columns(night.rows[f'{SHORT[axis]}_enc']) @ walk.discs
    began = night.rows['absolute_start']
    references, starts = {}, {}
    for run in night.tonight:
        mine = night.run == run
        at = mine & night.for_zero
        at = at if at.any() else mine
        at &= night.stretch == night.stretch[at].max()
        references[int(run)] = float(np.median(smooth[at]))
        if np.isfinite(began[at]).any():
            starts[int(run)] = float(began[at][np.isfinite(began[at])][-1])
    return references, starts


CAUSE = ('electromagnetic interference, a loose connector, dirt on the grating, or a zero that '
         'moves as it warms')


def follow_line(axis):
    """Why a zero follows, for the notes of a diagnosis; `axis` in words."""
    return (f'the counts of the {axis} encoder wander against the absolute encoder: {CAUSE}; the '
            'zero of this axis follows the absolute encoder, and rows are taken so')


def wander_line(event, rows):
    """What is said of a walk.

    Parameters
    ----------
    event : Event
        Of the kind ``wander``.
    rows : int
        In which it walked.
    """
    if event.moved != INCREMENTAL:
        whose = '' if event.confidence >= _TRUST else ', or that against it: the stars do not tell'
        return (f'{event.axis}: {ABSOLUTE} wanders against the incremental one{whose}, by '
                f'{abs(event.amount) / ARCSEC:.2f} arcsec within {rows} rows (confidence '
                f'{event.confidence:.2f}, by chance {event.probability:.1g})')
    heals = ('its zero follows the other' if event.confidence >= _TRUST else
             'the stars do not tell which of the two it is: nothing follows')
    return (f'{event.axis}: {INCREMENTAL}: the counts of the {event.axis} encoder wander against '
            f'the absolute encoder, by {abs(event.amount) / ARCSEC:.2f} arcsec within {rows} rows: '
            f'{CAUSE}; {heals} (confidence {event.confidence:.2f}, by chance '
            f'{event.probability:.1g})')

