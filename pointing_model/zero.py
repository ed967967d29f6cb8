# Copyright 2026 telescope_mount developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Zeros of the encoders: for one run (a night, a power-on), and for several runs.

A zero is the offset of the encoder readings in coordinate angles: subtract it from them.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from msg_tools.units import ARCSEC

from .sky.star_catalogue import POLARIS_HIP


@dataclass(frozen=True)
class PowerOnZero:
    """Zero of both axes for one run.

    Parameters
    ----------
    az, el : float
        Coordinate angles (not on the sky), radians: subtract them from the encoder readings.
    covariance : ndarray, shape (2, 2), optional
        Covariance of (az, el), radians^2.
    run : int or float, optional
        Number of the run, as in the column ``run``.
    started : float, optional
        Begin of the encoder's power-on, UTC s, as in the column ``encoder_start``: the zero is
        valid for this power-on only.
    model : str, optional
        `model_document.identity` of the model that it was determined with: with another model
        the pointing is wrong.
    by : str, optional
        How it was determined, see `way_of`; None: Polaris, or unknown.
    """

    az: float
    el: float
    covariance: np.ndarray | None = field(default=None, compare=False)
    run: float | None = None
    started: float | None = field(default=None, compare=False)
    model: str | None = field(default=None, compare=False)
    by: str | None = field(default=None, compare=False)

    @property
    def angles(self):
        """Azimuth and elevation, shape (2,), radians."""
        return np.array([self.az, self.el])

    @property
    def sigma(self):
        """Standard errors of azimuth and elevation, shape (2,), radians; NaN if unknown."""
        if self.covariance is None:
            return np.full(2, np.nan)
        return np.sqrt(np.diag(self.covariance))

    @property
    def sigma_az(self):
        """Standard error of `az`, radians."""
        return float(self.sigma[0])

    @property
    def sigma_el(self):
        """Standard error of `el`, radians."""
        return float(self.sigma[1])

    def row_angles(self, run):
        """The angles for each row of a PointingRun, here the same for all.

        Returns
        -------
        az, el : float
            Radians.
        """
        return self.az, self.el

    def plus(self, az, el):
        """The zero shifted by two angles, radians; the result has no covariance."""
        return PowerOnZero(self.az + az, self.el + el, run=self.run)

    def to_dict(self):
        """``run`` (if known), ``az_arcsec``, ``el_arcsec``; JSON-ready."""
        run = {} if self.run is None else {'run': self.run}
        return {**run, 'az_arcsec': self.az / ARCSEC, 'el_arcsec': self.el / ARCSEC}

    @classmethod
    def from_dict(cls, document):
        """Read `to_dict`'s document; other keys are ignored.

        Raises
        ------
        ValueError
            An angle is missing or not a number.
        """
        try:
            return cls(document['az_arcsec'] * ARCSEC, document['el_arcsec'] * ARCSEC,
                       run=document.get('run'))
        except (KeyError, TypeError, AttributeError):
            raise ValueError(f'not a zero with az_arcsec and el_arcsec: {document!r:.60}') from None


#: key of a model's provenance: zeros of the runs of a file, relative to its index terms
OF_RUNS = 'zeros_of_runs'
#: raw angles
NO_ZERO = PowerOnZero(0.0, 0.0)


class Zeros(dict):
    """Zero of each run: number -> PowerOnZero. A missing run raises an error.

    `filled` and `carried` supply zeros for missing runs.

    Parameters
    ----------
    zeros : iterable of PowerOnZero
        Each with its ``run``.

    Raises
    ------
    ValueError
        If a run without a zero is requested.
    """

    def __init__(self, zeros=()):
        super().__init__((zero.run, zero) for zero in zeros)

    def __missing__(self, number):
        raise ValueError(f'no zero for run {number}; measure it or leave the run out')

    @property
    def newest(self):
        """Zero of the run with the highest number; ValueError if there is none."""
        if not self:
            raise ValueError('no zero of any run; measure one')
        return self[max(self)]

    def row_angles(self, run):
        """The angles for each row of a PointingRun.

        Returns
        -------
        az, el : ndarray, shape (n,)
            Radians.

        Raises
        ------
        ValueError
            There is no column ``run``, or a run of it has no zero.
        """
        if 'run' not in run:
            raise ValueError('zeros by run number need the column run; add it or give one zero')
        az, el = np.empty((2, len(run)))
        for number in np.unique(run['run']):
            rows = run['run'] == number
            az[rows], el[rows] = self[number].angles
        return az, el

    def filled(self, numbers, missing):
        """A copy with the zero `missing` (a PowerOnZero) for those of `numbers` that have none."""
        return Zeros([*self.values(), *(replace(missing, run=n) for n in numbers
                                        if n not in self)])

    def carried(self, numbers, first=None):
        """A zero for each of `numbers`; a missing one is taken from the run before it.

        Parameters
        ----------
        numbers : sequence of int or float
        first : PowerOnZero, optional
            For runs before the first known zero; by default that zero.
        """
        known = sorted(self)
        out = []
        for number in numbers:
            before = [k for k in known if k <= number]
            zero = self[before[-1]] if before else first or self[known[0]] if known else NO_ZERO
            out.append(PowerOnZero(zero.az, zero.el, zero.covariance, number))
        return Zeros(out)

    def to_list(self):
        """`PowerOnZero.to_dict` of each; JSON-ready."""
        return [zero.to_dict() for zero in self.values()]

    @classmethod
    def from_list(cls, documents):
        """Read `to_list`'s documents; ValueError if one is invalid."""
        return cls(map(PowerOnZero.from_dict, documents))


def active_zeros(model):
    """The zeros that were active for a model, from its provenance.

    Parameters
    ----------
    model : PointingModel or None

    Returns
    -------
    Zeros
        For the power-ons of the fit; empty if unknown.
    """
    return _zeros_of(model, 'zeros_in_force')


def _zeros_of(model, key):
    documents = None if model is None else model.provenance.get(key)
    return Zeros.from_list(documents if isinstance(documents, list) else ())


def carried_zeros(model):
    """The `active_zeros` of a model, or the zeros of the runs of the file that it was fitted to."""
    return active_zeros(model) or _zeros_of(model, OF_RUNS)


def active_zero(model):
    """The newest of `active_zeros`, or `NO_ZERO` if unknown."""
    zeros = active_zeros(model)
    return zeros.newest if zeros else NO_ZERO


#: column of a run: 1 where the observer took the row to set a zero, with stars other than Polaris
MARK = 'for_zero'
#: methods to determine a zero, in words
BY_POLARIS, BY_STARS = 'Polaris', 'stars'


def is_of_polaris(rows):
    """Which rows are exposures of Polaris, ndarray of bool, shape (n,)."""
    return np.asarray(rows['star'] == POLARIS_HIP)


def is_marked(rows):
    """Which rows the observer marked as exposures of stars to set a zero.

    Parameters
    ----------
    rows : PointingRun
        Logs older than the column `MARK` have none.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    return np.nan_to_num(np.asarray(rows.get(MARK, 0.0), dtype=float)) != 0.0


def is_for_zero(rows):
    """Which rows are exposures to set a zero: marked ones, and Polaris, which needs no mark.

    The fit of terms and zeros uses them. They are not used as stars for splits, resampling or
    validation.

    Parameters
    ----------
    rows : PointingRun
        With the column ``star``.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    return is_of_polaris(rows) | is_marked(rows)


def way_of(rows):
    """Method by which these exposures determine a zero, in words.

    Parameters
    ----------
    rows : PointingRun
        Exposures to set a zero.

    Returns
    -------
    str
        ``Polaris``, ``stars (5)`` with the number of different ones, or ``Polaris and stars (5)``.
    """
    polaris = is_of_polaris(rows)
    others = len(np.unique(rows['star'][~polaris]))
    stars = f'{BY_STARS} ({others})' if others else ''
    return ' and '.join(filter(None, [BY_POLARIS if polaris.any() else '', stars]))
