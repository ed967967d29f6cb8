"""The message of a zero: a JointState on the topic ``zero``, and back.

Its ``frame_id`` says what the zero is worth anything with: ``power_on_2``, the number of the run;
``@1768482000.500``, when that power-on of the encoder began; ``/3f2a90c1d5e7``, the model;
``+stars``, that it was got by other stars than Polaris.
"""

import re

import numpy as np

from msg_tools.convert import AXES, joint_state, read_joints

from .zero import BY_POLARIS, BY_STARS, RunZero

_PREFIX = 'power_on_'
_FRAME = re.compile(_PREFIX + r'(?P<run>-?\d+)(?:@(?P<started>\d+(?:\.\d+)?))?(?:/(?P<model>\w+))?'
                    rf'(?:\+(?P<by>{BY_STARS}))?')


def zero_to_joints(zero, ns, names=AXES):
    """A JointState: ``position`` the zero, ``effort`` its sigma (rad), ``frame_id`` its identity.

    Parameters
    ----------
    zero : RunZero
    ns : int
        Stamp of the newest observation that it rests on.
    names : sequence of str
        Of the axes (`msg_tools.convert.JOINTS`).
    """
    frame = ''
    if zero.run is not None:
        frame = f'{_PREFIX}{int(zero.run)}'
        frame += '' if zero.started is None else f'@{zero.started:.3f}'
        frame += '' if zero.model is None else f'/{zero.model}'
        frame += '' if zero.by in (None, BY_POLARIS) else f'+{BY_STARS}'
    return joint_state(ns, zero.angles, effort=zero.sigma, frame=frame, names=names)


def joints_to_zero(message, run=None):
    """The way back from `zero_to_joints`.

    Parameters
    ----------
    message : sensor_msgs.msg.JointState
    run : int or float, optional
        Number of the run where the message does not tell it (older logs do not): that of the
        last observation before it.

    Returns
    -------
    ns : int
        Stamp.
    zero : RunZero
        Without a covariance where the message gives no sigma; without ``started`` and ``model``
        where it does not tell them.

    Raises
    ------
    ValueError
        An axis is missing or not a number.
    """
    ns, angles, _, sigma = read_joints(message)
    if not np.isfinite(angles).all():
        raise ValueError('zero is not a number')
    with np.errstate(over='ignore'):  # who uses it asks whether it can be
        covariance = np.diag(np.square(sigma)) if np.isfinite(sigma).all() else None
    frame = message.header.frame_id
    if not frame.startswith(_PREFIX):
        return ns, RunZero(*angles, covariance, run)
    told = _FRAME.fullmatch(frame)
    if told is None:
        raise ValueError(f'zero of {frame!r}: no number of a power-on')
    started = told['started']
    return ns, RunZero(*angles, covariance, int(told['run']),
                       None if started is None else float(started), told['model'], told['by'])
