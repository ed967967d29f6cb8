"""How a guard sends what it lets pass."""

from typing import NamedTuple

from msg_tools.units import DEG


class GuardSettings(NamedTuple):
    """How a `Keeper` sends.

    Attributes
    ----------
    whole : bool
        The judged track at once; nothing is renewed, and silence is no matter.
    ahead : float
        From now to the last moving knot of a piece, s.
    silence, commander : float
        Seconds without a reading, and without a renewed request, after which the axes are stopped.
    behind : float
        Largest distance of an axis from where it was sent, rad.
    turn_known : bool
        The first axis reads the turn that it is on.
    asleep : bool
        Time waits for events: of a mount that is not asked to move nothing is read.
    """

    whole: bool = True
    ahead: float = 1.5
    silence: float = 0.5
    commander: float = 0.45
    behind: float = 2.0 * DEG
    turn_known: bool = True
    asleep: bool = False
