"""What wanders in a run, its cause unproven: how large it is there, and whether it goes one way."""

import numpy as np

from msg_tools.units import ARCSEC

from .correlated_noise import White

_SOME = 600  # rows at a time: the effort grows with the cube


def slow_part(problem, chosen, axes):
    """What the wander did in the rows, as far as these tell (simple kriging).

    Cressie 1993, Statistics for Spatial Data, section 3.2; as `unexplained.ahead`, but there.

    Parameters
    ----------
    problem : Problem
    chosen : list of Choice
        In the model.
    axes : dict of str to AxisWander
        Those of ``az``, ``el`` that wander.

    Returns
    -------
    ndarray, shape (2, n)
        Radians on the sky; 0 in rows without weight.
    """
    sequence, plain = problem.sequence, problem.plain.state(chosen)
    raw, root = (v.reshape(2, -1) for v in (plain.raw, plain.white.root))
    out = np.zeros_like(raw)
    for name, one in axes.items():
        axis = ('az', 'el').index(name)
        rows = sequence.order[root[axis][sequence.order] > 0.0]
        for begin in range(0, len(rows), _SOME):
            part = rows[begin:begin + _SOME]
            on_sky = sequence.cos_el[part] if one.angle else np.ones(len(part))
            since = np.abs(sequence.position[part][:, None] - sequence.position[part])
            alike = one.variance * np.exp(-since / one.memory) * (
                sequence.run[part][:, None] == sequence.run[part])
            noise = np.square(one.scale / (root[axis, part] * plain.scale[axis] * on_sky))
            out[axis, part] = on_sky * (alike @ np.linalg.solve(
                alike + np.diag(noise), raw[axis, part] / on_sky))
    return out


def beyond_terms(problem, offsets, chosen=()):
    """RMS of some offsets, radial on the sky, beyond what the declared terms take up, arcsec.

    As `summary.beyond_base`, of a result that there is not yet: over the rows with weight.

    Parameters
    ----------
    problem : Problem
    offsets : ndarray, shape (2, n)
        Radians.
    chosen : list of Choice
        The effects in the model, beside which rows have their weight.
    """
    live = problem.plain.state(list(chosen)).weights > 0.0
    left = problem.base.left_of(offsets.ravel(), White(np.tile(live, 2).astype(float)))
    return float(np.sqrt(np.square(left.reshape(2, -1)[:, live]).sum() / max(live.sum(), 1))
                 / ARCSEC)


def trend(problem, chosen, name, one):
    """By how much an axis drifts evenly, and how much of what is left of it that explains.

    Parameters
    ----------
    problem : Problem
    chosen : list of Choice
        In the model.
    name : {'az', 'el'}
    one : AxisWander

    Returns
    -------
    dict or None
        ``rate_arcsec_per_hour`` (of the angle of the axis), ``share`` (of the variance that is
        left on it) and ``removes_rms_arcsec`` (radial on the sky, beyond the terms); None where
        the rows have no times.
    """
    sequence, n = problem.sequence, problem.n
    if not sequence.timed:
        return None
    plain = problem.plain.state(chosen)
    part = slice(0, n) if name == 'az' else slice(n, 2 * n)
    hours = sequence.position / 3600.0
    run = np.unique(sequence.run, return_inverse=True)[1]
    hours = hours - (np.bincount(run, hours) / np.bincount(run))[run]
    column = np.zeros(2 * n)
    column[part] = hours * (sequence.cos_el if one.angle else 1.0)
    own, left = plain.basis.off(plain.white(column)), plain.white(plain.raw)
    size = float(own @ own)
    rate = float(own @ left) / max(size, 1e-300)
    share = rate**2 * size / max(float(np.square(left[part]).sum()), 1e-300)
    return {'rate_arcsec_per_hour': rate / ARCSEC, 'share': share,
            'removes_rms_arcsec': beyond_terms(problem, (rate * column).reshape(2, -1), chosen)}
