"""What a judge says of a track."""

from typing import NamedTuple

from .axis_track import Cubic


class Allowed(NamedTuple):
    """A track that may be sent.

    Attributes
    ----------
    cubic : Cubic
        Its knots, the first axis on the turn that the mount takes.
    """

    cubic: Cubic


class Refused(NamedTuple):
    """A track that may not: one line that says what, where and what to do.

    Attributes
    ----------
    reason : str
    cubic : Cubic or None
        The track, where it could be followed and only the way onto it cannot be gone.
    """

    reason: str
    cubic: Cubic | None = None
