"""The message of a zero: a JointState on the topic ``zero``, and back."""

import numpy as np

from msg_tools.convert import joint_state, read_joints

from .zero import RunZero

_PREFIX = 'power_on_'


def zero_to_joints(zero, ns):
    """A JointState: ``position`` the zero, ``effort`` its sigma (rad), ``frame_id`` its run.

    Parameters
    ----------
    zero : RunZero
    ns : int
        Stamp of the newest observation that it rests on.
    """
    frame = '' if zero.run is None else f'{_PREFIX}{int(zero.run)}'
    return joint_state(ns, zero.angles, effort=zero.sigma, frame=frame)


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
        Without a covariance where the message gives no sigma.

    Raises
    ------
    ValueError
        An axis is missing or not a number.
    """
    ns, angles, _, sigma = read_joints(message)
    if not np.isfinite(angles).all():
        raise ValueError('zero is not a number')
    known = np.isfinite(sigma).all()
    frame = message.header.frame_id
    if frame.startswith(_PREFIX):
        try:
            run = int(frame[len(_PREFIX):])
        except ValueError:
            raise ValueError(f'zero of {frame!r}: no number of a power-on') from None
    return ns, RunZero(*angles, np.diag(np.square(sigma)) if known else None, run)
