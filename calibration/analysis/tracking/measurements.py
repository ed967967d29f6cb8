"""What a tracker is told, and what it answers."""

from dataclasses import dataclass

import numpy as np

from msg_tools.units import ARCSEC


@dataclass(frozen=True)
class Seen:
    """An observation as it stands in a log.

    Attributes
    ----------
    what : {'star', 'difference', 'inclinometer', 'power_on'}
        The method of `Tracker` that takes it.
    stamp : int
        ns.
    values : tuple
        The rest of what the method takes.
    """

    what: str
    stamp: int
    values: tuple = ()


@dataclass(frozen=True)
class Heard:
    """What came of an observation.

    Attributes
    ----------
    stamp : int
        ns.
    what : str
        ``star``, ``difference`` or ``inclinometer``.
    taken : bool
        False: refused, and nothing has changed.
    why : str
        One line: why it was refused, or what was widened for it.
    innovation : ndarray, shape (m,), or None
        Beyond what was expected, rad.
    covariance : ndarray, shape (m, m), or None
        Of it, if nothing has happened, rad^2.
    chances : dict of str to float
        What may have happened just before: each that may have jumped, ``wrong star``; and
        ``nothing``. All 0 for the first stars of a night that decide how it begins (`opening`).
    called : tuple of str
        Sentences about what is decided now, also of the stars before.
    confidence : str
        One line where the filter has just found itself over- or under-confident, else ''.
    """

    stamp: int
    what: str
    taken: bool
    why: str = ''
    innovation: np.ndarray | None = None
    covariance: np.ndarray | None = None
    chances: dict | None = None
    called: tuple = ()
    confidence: str = ''

    @property
    def nis(self):
        """Normalised innovation squared: of mean m where the filter is honest."""
        if self.innovation is None:
            return float('nan')
        return float(self.innovation @ np.linalg.solve(self.covariance, self.innovation))

    def document(self):
        """JSON-ready; angles in arcsec."""
        out = {'stamp': self.stamp, 'what': self.what, 'taken': self.taken, 'why': self.why}
        if self.taken:
            out |= {'innovation_arcsec': (self.innovation / ARCSEC).tolist(),
                    'sigma_arcsec': (np.sqrt(np.diag(self.covariance)) / ARCSEC).tolist(),
                    'nis': self.nis, 'chances': self.chances, 'called': list(self.called),
                    'confidence': self.confidence}
        return out


@dataclass(frozen=True)
class Expected:
    """How far the mount is expected to point off.

    Attributes
    ----------
    covariance : ndarray, shape (..., 2, 2)
        Of x and y on the sky, rad^2.
    jump : float
        Chance that something jumps in the time ahead, which is not in the covariance.
    """

    covariance: np.ndarray
    jump: float

    @property
    def radial(self):
        """Radial RMS, rad."""
        return np.sqrt(np.trace(self.covariance, axis1=-2, axis2=-1))
