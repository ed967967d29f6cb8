"""What a mount is pointed at: a star of the catalogue, or a satellite by its elements."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from .catalogue import Stars
from .sky import observed_place


@dataclass(frozen=True)
class StarTarget:
    """One star.

    Parameters
    ----------
    stars : Stars
        Of one row.
    """

    stars: Stars

    @cached_property
    def number(self):
        """Hipparcos number: `star` of the run."""
        return int(self.stars.hip[0])

    @property
    def name(self):
        """For people."""
        return f'HIP {self.number}'

    @property
    def magnitude(self):
        """Of the catalogue."""
        return float(self.stars.mag[0])

    def place(self, time, site, weather):
        """Observed place at each time (n,), UTC s: az, el (n,), radians."""
        rows = self.stars.select(np.zeros(len(time), int))
        return observed_place(rows, time, site, weather)


@dataclass(frozen=True)
class SatelliteTarget:
    """A satellite of the Earth.

    Parameters
    ----------
    satellite : satellite.Satellite
    """

    satellite: object

    @property
    def number(self):
        """Its catalogue number, negative: `star` of the run."""
        return -int(self.satellite.number)

    @property
    def name(self):
        """For people."""
        return f'satellite {self.satellite.number}'

    @property
    def magnitude(self):
        """Nothing that elements tell."""
        return np.nan

    def place(self, time, site, weather):
        """Observed place at each time (n,), UTC s: az, el (n,), radians."""
        from .satellite import satellite_place
        return satellite_place(self.satellite, time, site, weather)[:2]


def satellite_target(text):
    """The satellite that a parameter names.

    Parameters
    ----------
    text : str
        ``gps-26690`` for the one of paper 000, or a file with the two-line elements of one.

    Returns
    -------
    SatelliteTarget or None
        None for an empty text.

    Raises
    ------
    ValueError
        The elements are wrong.
    OSError
        The file cannot be read.
    """
    if not text:
        return None
    # sgp4 costs every start of a node; only who tracks a satellite needs it
    from .elements import GPS_26690, load_elements, parse_elements
    if text == 'gps-26690':
        return SatelliteTarget(parse_elements('\n'.join(GPS_26690)))
    return SatelliteTarget(load_elements(Path(text)))
