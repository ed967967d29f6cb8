"""What a mount is pointed at: a star of the catalogue, or a satellite by its elements."""

import numpy as np

from .places import observed_place


class StarTarget:
    """One star.

    Parameters
    ----------
    stars : Stars
        Of one row.

    Attributes
    ----------
    number : int
        Hipparcos number: `star` of the run.
    name : str
        For people.
    magnitude : float
        Of the catalogue.
    """

    def __init__(self, stars):
        self._stars = stars
        self.number = int(stars.hip[0])
        self.name = f'HIP {self.number}'
        self.magnitude = float(stars.mag[0])

    def place(self, time, site, weather):
        """Observed place at each time (n,), UTC s: az, el (n,), radians."""
        return observed_place(self._stars, time, site, weather)


class SatelliteTarget:
    """A satellite of the Earth, as a `StarTarget`; its number is the catalogue's, negative.

    Parameters
    ----------
    satellite : elements.Satellite
    """

    magnitude = np.nan  # nothing that elements tell

    def __init__(self, satellite):
        self._satellite = satellite
        self.number = -int(satellite.number)
        self.name = f'satellite {satellite.number}'

    def place(self, time, site, weather):
        """Observed place at each time (n,), UTC s: az, el (n,), radians."""
        from .satellite import satellite_place
        return satellite_place(self._satellite, time, site, weather)[:2]


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
        return SatelliteTarget(parse_elements(GPS_26690))
    return SatelliteTarget(load_elements(text))
