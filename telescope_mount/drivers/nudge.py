"""What small moves of each axis show: the mount that follows, the camera that sees it."""

import numpy as np

from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.sky.places import DEFAULT_WEATHER, observed_place
from pointing_model.sky.star_catalogue import StarTarget, load_catalogue

from ..observing.axis_demand import Pointing
from ..observing.star_choice import AxisLimits, axes_at, has_neighbour
from .samples import NOTE, OK, WRONG, Remark

#: by how much a camera may be turned and its scale be wrong, rad and 1
TURNED, SCALED = 2.0 * DEG, 0.05
#: how far a nudge may end from its demand, rad
FOLLOWED = 30.0 * ARCSEC
#: a mount that was stopped farther from its begin went somewhere, rad
FAR = 0.2 * DEG


def judge_nudge(heard, rests, star=False):
    """What small moves of each axis show.

    Parameters
    ----------
    heard : Heard
        Of the time of the moves.
    rests : list of Rest
        Five: at the begin, with the first axis moved, back, with the second one moved, back.
    star : bool
        A bright star must be in the field.

    Returns
    -------
    list of Remark
    """
    out = []
    stamps, values, _ = heard.incremental.arrays()
    names = heard.mount.names.axes
    means = []
    for rest in rests:
        here = values[(stamps >= rest.begin) & (stamps <= rest.end)]
        here = here[np.isfinite(here).all(axis=1)]
        if not len(here):
            return [Remark(WRONG, heard.incremental.topic, 'no reading while it was nudged')]
        means.append(rest.demand + np.column_stack(
            [wrap(here[:, 0] - rest.demand[0]), here[:, 1] - rest.demand[1]]).mean(axis=0))
    followed = True
    for axis, moved in ((0, 1), (1, 3)):
        step = rests[moved].demand - rests[moved - 1].demand
        size = abs(step[axis])
        went = (means[moved] - means[moved - 1]) / step[axis]
        off = float(np.abs(means[moved] - rests[moved].demand).max())
        text = None
        if abs(went[axis]) < 0.2 and abs(went[1 - axis]) > 0.5:
            text = f'axes exchanged: {names[1 - axis]} moved for {names[axis]}'
        elif went[axis] < -0.2:
            text = f'{names[axis]} went the other way'
        elif abs(went[axis]) < 0.2:
            text = f'{names[axis]} did not move for a command of {size / DEG:.3g} deg'
        elif abs(went[axis] - 1.0) > 0.1:
            text = f'{names[axis]} moved {went[axis]:.3g} times as far as commanded'
        elif off > FOLLOWED:
            text = f'{names[axis]} ended {off / ARCSEC:.0f} arcsec from the demand'
        followed &= text is None
        out.append(Remark(OK, 'command', f'{names[axis]} follows, to {off / ARCSEC:.1f} arcsec')
                   if text is None else Remark(WRONG, 'command', text))
    if followed:
        _nudged_camera(out, heard, rests, star)
    return out


def _nudged_camera(out, heard, rests, star):
    """Sign, rotation and scale from how the star moved, beside its own drift."""
    of = heard.camera.topic
    stamps, values, _ = heard.camera.arrays()
    rows, seen = [], []
    home = rests[0].demand
    start = rests[0].begin
    for rest in rests:
        inside = (stamps >= rest.begin) & (stamps <= rest.end) & np.isfinite(values).all(axis=1)
        away = (rest.demand - home) * (np.cos(home[1]), 1.0)
        rows += [(1.0, stamp - start, *away) for stamp in stamps[inside]]
        seen += list(values[inside])
        if not inside.any():
            out.append(Remark(
                WRONG, of, 'not the star that must be in the field: is the site right, and the '
                'clock, does the mount point to within the field, are the axes exchanged in both '
                'drivers, does the camera answer?') if star else Remark(
                NOTE, of, 'no star in the field at each step: camera not judged; point at a '
                'bright star first (--star)'))
            return
    rows, seen = np.array(rows), np.array(seen)
    if len(rows) < 6:
        out.append(Remark(NOTE, of, f'{len(rows)} exposures: too few to judge the camera'))
        return
    answer, *_ = np.linalg.lstsq(rows / np.abs(rows).max(axis=0), seen, rcond=None)
    moves = (answer / np.abs(rows).max(axis=0)[:, None])[2:].T  # column k: for axis k
    left = float(np.sqrt(np.mean((seen - rows @ (
        answer / np.abs(rows).max(axis=0)[:, None])) ** 2)))
    step = float(np.abs(rows[:, 2:]).max())
    scale = float(np.sqrt(abs(np.linalg.det(moves))))
    if left > 0.2 * step * max(scale, 0.1):
        out.append(Remark(NOTE, of, f'the star does not move evenly ({left / ARCSEC:.0f} arcsec '
                           'left): another star, or the mount does not rest; camera not judged'))
        return
    if scale < 0.1:
        out.append(Remark(WRONG, of, 'the star does not move with the mount'))
        return
    mirrored = np.linalg.det(moves) < 0.0
    unit = -moves / scale
    if mirrored:
        flips = ((np.diag([-1.0, 1.0]), 'x has the other sign'),
                 (np.diag([1.0, -1.0]), 'y has the other sign'),
                 (np.array([[0.0, 1.0], [1.0, 0.0]]), 'x and y are exchanged'))
        gap, text = min((float(np.abs(unit - flip).max()), text) for flip, text in flips)
        out.append(Remark(WRONG, of, f'{text}' if gap < 0.3 else
                           'mirrored and turned: one of x and y has the other sign'))
    else:
        turn = float(np.arctan2(unit[1, 0] - unit[0, 1], unit[0, 0] + unit[1, 1]))
        if abs(abs(turn) - np.pi) < 10.0 * DEG:
            text = 'both signs are reversed: it must be star - boresight'
        else:
            text = f'turned by {turn / DEG:.1f} deg'
        level = WRONG if abs(turn) > TURNED else OK
        out.append(Remark(level, of, text + ' against the axes' * ('turned' in text)))
    unit_of = {'arcsec for radians?': ARCSEC**-1, 'degrees for radians?': DEG**-1}
    guess = next((text for text, value in unit_of.items() if 0.5 < scale / value < 2.0), '')
    level = WRONG if abs(scale - 1.0) > SCALED else OK
    out.append(Remark(level, of, f'scale {scale:.4g}, 1 would be right' * (level == WRONG)
                       + f'scale right to {abs(scale - 1.0):.1%}' * (level == OK)
                       + f': {guess}' * bool(guess)))


def went_elsewhere(before, after, mount):
    """Where axes went that were stopped while they were nudged, '' where they hardly moved.

    Parameters
    ----------
    before, after : ndarray, shape (2,)
        rad; `after` None where it is not known.
    mount : Mount

    Returns
    -------
    str
    """
    if after is None or np.abs(after - before).max() < FAR:
        return ''
    first, second = mount.names.axes
    moved, exchanged = after - before, before[::-1] - before
    text = (f' (it had moved {first} by {moved[0] / DEG:+.1f}, {second} by '
            f'{moved[1] / DEG:+.1f} deg')
    if moved @ exchanged > 0.9 * np.linalg.norm(moved) * np.linalg.norm(exchanged):
        text += ': toward where it is with the axes exchanged; look at what follows command'
    return text + ')'


#: faintest of them, Hipparcos magnitude, and how high they stand, rad
BRIGHT, LOW, HIGH = 3.0, 30.0 * DEG, 75.0 * DEG


def standing(here):
    """The place of a mount that stays, as `place_of` a star: ``place(times)``, rad, (n, 2)."""
    return lambda times: np.tile(here, (len(times), 1))


def place_of(target, mount, site, here):
    """Where a perfect mount reads while it follows a star, on the turn nearest to `here`.

    Parameters
    ----------
    target : StarTarget
    mount : Mount
    site : Site
    here : ndarray, shape (2,)
        rad.

    Returns
    -------
    callable
        ``place(times)``: angles (n, 2), rad, at times (n,), UTC s.
    """
    pointing = Pointing(target, None, np.zeros(2), mount, AxisLimits().meridian)

    def angles(times):
        first, second = pointing.place(np.asarray(times) * 1e9, site, DEFAULT_WEATHER)
        turns = np.round((here[0] - first[0]) / (2.0 * np.pi)) if mount.vertical else 0.0
        return np.column_stack([first + 2.0 * np.pi * turns, second])
    return angles


def bright_star(mount, site, time, here, allowed=None):
    """The bright star without a neighbour that the axes reach soonest.

    Parameters
    ----------
    mount : Mount
    site : Site
    time : float
        UTC, s.
    here : ndarray, shape (2,)
        Readings, rad.
    allowed : AllowedSky, optional
        Where the guard lets the tube look.

    Returns
    -------
    StarTarget

    Raises
    ------
    ValueError
        There is none.
    """
    stars, limits = load_catalogue(mag_limit=BRIGHT + 2.0), AxisLimits(allowed=allowed)
    rows = np.flatnonzero(stars.mag <= BRIGHT)
    az, el = observed_place(stars.select(rows), time, site, DEFAULT_WEATHER)
    good = (el > LOW) & (el < HIGH) & ~has_neighbour(stars, rows) & limits.reached(
        mount, az, el, HIGH if mount.vertical else 80.0 * DEG, time, stars.hip[rows])
    if not good.any():
        raise ValueError(f'no star brighter than {BRIGHT:g} between {LOW / DEG:.0f} and '
                         f'{HIGH / DEG:.0f} deg where the guard lets the tube look: look at site '
                         'and clock, or wait')
    first, second = axes_at(mount, az[good], el[good], limits, stars.hip[rows[good]])
    way = np.maximum(np.abs(mount.way(here[0], first)), np.abs(second - here[1]))
    return StarTarget(stars.select([rows[good][np.argmin(way)]]))
