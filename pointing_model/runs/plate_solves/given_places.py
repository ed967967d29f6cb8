"""Places of a plate-solved run as they were given, kept for what judges them."""

from dataclasses import dataclass

import numpy as np

from pointing_model.sky.places import Site, Weather, icrs_to_observed

from .frames import Frame, to_icrs


@dataclass(frozen=True)
class Solved:
    """Right ascensions and declinations of the rows of a run, before they were made observed.

    Parameters
    ----------
    lines : ndarray of int, shape (n,)
        Lines of the file, as `PointingRun.lines`.
    ra, dec : ndarray, shape (n,)
        As given, radians.
    time : ndarray, shape (n,)
        UTC, seconds since 1970.
    frame : Frame
        Declared, or taken where none was.
    declared : bool
        Whether the file, or its reader's caller, names the frame.
    site : Site
    weather : Weather
        Of each row.
    of_images : bool
        Whether the rows are solutions of images (they have a sigma or a scale of their own), not
        places of catalogue stars.
    """

    lines: np.ndarray
    ra: np.ndarray
    dec: np.ndarray
    time: np.ndarray
    frame: Frame
    declared: bool
    site: Site
    weather: Weather
    of_images: bool = False

    def observed(self, frame=None, ra=None):
        """Observed azimuth and elevation, radians, if the places were of another frame.

        Parameters
        ----------
        frame : Frame, optional
        ra : ndarray, shape (n,), optional
            Other right ascensions in their place.
        """
        ra, dec = to_icrs(self.ra if ra is None else ra, self.dec, frame or self.frame, self.time)
        return icrs_to_observed(ra, dec, self.time, self.site, self.weather)

    def at(self, lines):
        """Those of some lines, in their order.

        Parameters
        ----------
        lines : ndarray of int, shape (m,)
            Lines that are there.
        """
        order = np.argsort(self.lines, kind='stable')
        rows = order[np.searchsorted(self.lines[order], lines)]
        air = self.weather
        each = {name: np.broadcast_to(getattr(air, name), self.ra.shape)[rows]
                for name in ('pressure_hpa', 'temperature_c', 'humidity')}
        return Solved(self.lines[rows], self.ra[rows], self.dec[rows], self.time[rows], self.frame,
                      self.declared, self.site,
                      Weather(wavelength_um=air.wavelength_um, **each), self.of_images)
