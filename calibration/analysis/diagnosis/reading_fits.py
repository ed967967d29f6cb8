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

"""Fits of the mount terms to the rows of a file under other readings of its columns."""

from dataclasses import dataclass, replace

import numpy as np

from calibration.analysis.term_fit import fit_first_order, fit_terms
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.mounts import is_beyond, through_pole
from pointing_model.rms import sigma_of
from pointing_model.runs.columns.axis_places import rows_beyond_zenith, unfolded
from pointing_model.runs.columns.pier_side import read_beyond
from pointing_model.runs.run import PointingRun

from .readings import Reading, in_range

#: largest share of rows that may lie where no telescope points, and largest share of rows that may
#: be missing from a diagnosis that claims an effect
MOST_LEFT_OUT = 1.0 / 3.0
TAU = 3.0  # standard deviations at which the square of a residual is capped
FEW = 6  # fewest rows for a fit of seven terms
_TRIED = 16  # largest number of readings with two mistakes that are fitted
_CLOCKS = 4  # largest number of other clocks and sites that are fitted
_STEEPEST = 20.0 * DEG  # no mount has larger terms, except for the zeros
_SYNCED = 5.0 * DEG  # largest usual offset of a mount that is synchronised on each star
_HALF_A_QUARTER = 45.0 * DEG  # a larger zero of the second axis is another reading
_LIMITS = (-5.0 * DEG, 90.1 * DEG)
_HOPELESS = 5.0 * DEG  # first-order residual far above what large terms cause
_ZENITH = 89.0 * DEG  # no run has most of its rows above
_ONE_SIDE = 0.99  # resultant length of the first axis' offsets: all in one direction
_SMALLER = 1.05  # ratio of radial RMS from which one is smaller
_LOST = 7.0  # log-likelihood cost of a row that a reading places where no telescope points
#: smallest size, rad, and largest log ratio, of a log-uniform prior on zero and tilt
_SMALL, _MOST_OF_SIZES = 10.0 * ARCSEC, 8.0
#: numbers read as offsets must be this many times larger than their noise, or gain this much
#: log-likelihood from the terms; else there is no evidence that they are offsets
_OFFSETS_LARGER, _OFFSETS_LIKELIER = 5.0, 15.0


@dataclass
class ReadingFit:
    """Fit of the terms under one reading.

    Attributes
    ----------
    reading : Reading or MovedRun
    places : tuple of ndarray, shape (n,)
        Catalogue angles, encoder angles, run index.
    taken : float
        Zero of the first axis subtracted from the encoder angles before the fit, radians.
    sigma : ndarray, shape (2,)
        Noise of both axes, radians.
    freedom : int
        Degrees of freedom.
    misfit : float
        Mean logarithm of the noise, see `misfit`.
    lost : int
        Number of rows placed where no telescope points.
    zeros : tuple of float
        Zeros of both axes, radians.
    tilt : float
        Tilt of the first axis, radians.
    terms : tuple of str
        Fitted terms.
    names : mount_kinds.MountKind
    """

    reading: Reading
    places: tuple
    taken: float
    sigma: np.ndarray
    freedom: int
    misfit: float
    lost: int
    zeros: tuple
    tilt: float
    terms: tuple
    names: object

    @property
    def rms_arcsec(self):
        """Radial RMS."""
        return float(np.hypot(*self.sigma)) / ARCSEC

    @property
    def text(self):
        """Description of the reading, for users."""
        return self.reading.text(self.zeros[0], self.names)

    def better_than(self, other):
        """Noise ratio, and gain in log-likelihood (both axes, and rows no telescope points at).

        For another clock or site the sizes of zero and tilt count too, with a log-uniform prior.
        """
        gain = other.misfit - self.misfit
        likelier = min(self.freedom, other.freedom) * gain + _LOST * (other.lost - self.lost)
        if self.reading.elsewhere:
            likelier += sum(np.clip(np.log(max(b, _SMALL) / max(a, _SMALL)), -_MOST_OF_SIZES,
                                    _MOST_OF_SIZES) for a, b in zip(self.sizes, other.sizes))
        return np.exp(gain), likelier

    def as_good_as(self, other, least, likeliest):
        """Whether this fit is as good as another.

        That is, its log-likelihood is less than `likeliest` lower, or, with the same clock and
        site, its noise is less than `least` times larger and it loses no more rows.
        """
        times, likelier = self.better_than(other)
        return likelier > -likeliest or (
            times > 1.0 / least and self.lost <= other.lost and not self.reading.elsewhere)

    @property
    def sizes(self):
        """Absolute zero of the first axis and tilt, radians."""
        return abs(wrap(self.zeros[0])), self.tilt

    def far_better_than(self, other, least, likeliest):
        """Whether this fit is far better than another.

        That is, its log-likelihood is more than `likeliest` higher, and its noise is more than
        `least` times smaller (its radial RMS is smaller, too: terms that fit a noisy axis spoil
        the other), or it loses fewer rows, or has another clock or site.
        """
        times, likelier = self.better_than(other)
        smaller = times > least and self.rms_arcsec < other.rms_arcsec / _SMALLER
        return likelier > likeliest and (smaller or self.lost < other.lost
                                         or self.reading.elsewhere)

    def explains(self):
        """Whether numbers read as offsets exceed their scatter, or are explained by the terms."""
        return not self.reading.offsets or _explained(self.places, self.taken, self.sigma,
                                                      _OFFSETS_LIKELIER)


def _explained(places, taken, sigma, likelier):
    """Whether offsets exceed their residuals, or the terms fit them better than zeros alone do.

    Any numbers fit as offsets if the unit is small.
    """
    az, el, az_enc, el_enc, _ = places
    x, y = (az_enc - az + taken) * np.cos(el), el_enc - el
    columns = np.stack((np.cos(el), np.ones(len(el))), axis=-1)
    by_zeros = x - columns @ np.linalg.lstsq(columns, x, rcond=None)[0], y - np.median(y)
    size = [np.sqrt(np.median(np.square(v))) for v in (x, y)]
    gain = len(az) * float(np.sum(np.log(np.divide([scatter(v, 1.0) for v in by_zeros], sigma))))
    return bool(np.prod(np.divide(size, sigma)) > _OFFSETS_LARGER**2 or gain > likelier)


class ReadingFits:
    """Fits to the rows of a file under other readings of its columns.

    Parameters
    ----------
    rows : FileRows
    """

    def __init__(self, rows):
        self.rows, self.names = rows, rows.mount.names

    def fit(self, reading, centred=True, terms=None):
        """Robust fit of one reading: a `ReadingFit`, or None if it cannot be fitted.

        Parameters
        ----------
        reading : Reading or MovedRun
        centred : bool
            Whether the zero of the first axis is subtracted before the fit.
        terms : tuple of str, optional
            By default the seven physical terms of the mount.
        """
        terms, index = terms or self.names.physical, self.names.index
        found = self._places(reading, centred)
        if found is None:
            return None
        places, zero, gain, lost = found
        *angles, label = places
        n, several = len(label), len(np.unique(label)) > 1
        count = len(terms) + (2 * len(np.unique(label)) - 2 if several else 0)
        if 2 * n < count + 4:
            several, count = False, len(terms)
        if 2 * n < count + 4:
            terms, count = index, 2
        columns = dict(zip(('az', 'el', 'az_enc', 'el_enc'), angles))
        if several:
            columns['run'] = label
        try:
            with np.errstate(all='ignore'):
                fitted = fit_terms(PointingRun(columns, {'mount': self._mount(reading)}), terms,
                                   run_zeros=several)
        except (ValueError, np.linalg.LinAlgError):
            return None
        values = fitted.model.terms
        if any(abs(v) > _STEEPEST for t, v in values.items() if t not in index):
            return None
        dof = np.sqrt(2.0 * n / (2.0 * n - count))
        sigma = np.array([scatter(r[np.isfinite(r)], dof)
                          for r in (fitted.residual_x, fitted.residual_y)])
        if not np.isfinite(sigma).all():
            return None
        tilt = np.hypot(*(values.get(self.names.named(name), 0.0) for name in ('AN', 'AW')))
        return ReadingFit(reading, places, zero, sigma, 2 * n - count, misfit(sigma, gain), lost,
                   (zero + values[index[0]], values[index[1]]), float(tilt), terms, self.names)

    def best(self, readings, near=10.0):
        """Fit the most promising readings, best first.

        Readings are preselected by their noise with the zeros only, then by a first-order fit.

        Parameters
        ----------
        readings : sequence of Reading or MovedRun
        near : float
            Largest first-order noise of a reading kept, relative to the best.

        Returns
        -------
        list of ReadingFit
        """
        seen = [(reading, sight) for reading in readings if self._plausible(reading)
                for sight in (self._places(reading, True),) if sight is not None]
        for look, times in ((self._zeros_taken_off, 10.0), (self._first_order, near)):
            misfits = [look(reading, *sight) for reading, sight in seen]
            least = min([m for m in misfits if np.isfinite(m)], default=0.0) + np.log(times)
            ranked = sorted(zip(misfits, range(len(seen))))
            seen = [seen[i] for misfit, i in ranked if misfit <= least]
        near = [reading for reading, _ in seen]
        some = [reading for reading in near if reading.mistakes < 2 and not reading.elsewhere]
        some += [reading for reading in near if reading.elsewhere][:_CLOCKS]
        some += [reading for reading in near if reading.mistakes == 2][:_TRIED]
        fits = [fit for fit in map(self.fit, some)
                if fit is not None and abs(fit.zeros[1]) < _HALF_A_QUARTER]
        return sorted(fits, key=lambda fit: fit.misfit)

    def _mount(self, reading):
        return reading.mount if reading.elsewhere else self.rows.mount

    def _plausible(self, reading):
        """Whether the numbers are in the range of a reading, and it differs from the file as is."""
        az, el, az_enc, el_enc = self.rows.columns
        if not (in_range(reading.catalogue, az, el) and in_range(reading.encoders, az_enc, el_enc)):
            return False
        beyond = read_beyond(self.rows.mount, (az, el), (az_enc, el_enc),
                             np.isfinite(az_enc + el_enc))
        names = reading.encoders
        return not (
            'ascension' in (*names, *reading.catalogue) and 'hours' in (*names, *reading.catalogue)
            or 'synced' in names and np.median(np.hypot(wrap(az_enc - az), el_enc - el)) > _SYNCED
            or 'unturned' in names and not beyond.any()
            or 'folded' in names and abs(np.exp(1j * (az_enc - az)).mean()) > _ONE_SIDE
            or 'sideless' in names and (beyond.any() or self.rows.beyond is not None
                                        or not (self.rows.mount.two_sided or self.rows.assumed)))

    def _places(self, reading, centred):
        """Usable positions of a reading, the zero subtracted, its mean log gain, rows lost."""
        with np.errstate(invalid='ignore', over='ignore', divide='ignore'):
            p = reading.places(*self.rows.columns, held=self.rows.held, lst=self.rows.lst,
                               sidereal=self.rows.sidereal)
            p = self._beyond_zenith(p, reading) if self.rows.mount.vertical else \
                self._by_axes(p, reading)
            high = self._mount(reading).horizon_of(p.az, p.el)[1]
            good = np.isfinite(p.az_enc + p.el_enc) & (high >= _LIMITS[0]) & (high <= _LIMITS[1])
        if good.sum() < FEW or good.mean() < 1.0 - MOST_LEFT_OUT:
            return None
        az, el, az_enc, el_enc, gain = (
            v[good] for v in (p.az, p.el, p.az_enc, p.el_enc, p.gain))
        if np.median(high[good]) > _ZENITH:
            return None
        zero = 0.0
        if centred:
            away = az_enc - az
            zero = np.angle(np.exp(1j * away).mean())
            zero += np.median(wrap(away - zero))
            az_enc = az + wrap(away - zero)
        return (az, el, az_enc, el_enc, self.rows.label[good]), zero, float(
            np.mean(np.log(np.maximum(gain, 1e-9)))), int((~good).sum())

    def _by_axes(self, p, reading):
        """Positions as axis angles, each on the side of the pole of its encoder angles.

        The side comes from the encoder angles, or else from a column, as in
        `axis_places.to_axes`.
        """
        az_enc, el_enc, beyond = p.az_enc, p.el_enc, self.rows.beyond
        if reading.exchanged and beyond is None:
            beyond = is_beyond(p.el)
        read = read_beyond(self._mount(reading), (p.az, p.el), (az_enc, el_enc),
                           np.isfinite(az_enc + el_enc))
        if beyond is not None and not read.any():
            az_enc, el_enc = through_pole(az_enc, el_enc, beyond)
            read = beyond
        az, el = through_pole(p.az, p.el, is_beyond(p.el) != read)
        return replace(p, az=az, el=el, az_enc=az + wrap(az_enc - az),
                       el_enc=el + wrap(el_enc - el))

    @staticmethod
    def _beyond_zenith(p, reading):
        """The same for an alt-azimuth mount, as in `axis_places.past_zenith`."""
        place, reads = (p.az, p.el), (p.az_enc, p.el_enc)
        turned = reading.exchanged and is_beyond(place[1]).sum() > is_beyond(reads[1]).sum()
        if turned:
            place, reads = reads, place
        beyond, _ = rows_beyond_zenith(place, reads, (place[1] >= _LIMITS[0])
                                       & (place[1] <= _LIMITS[1]))
        if not beyond.any():
            return p
        place = through_pole(*place, beyond)
        reads = reads[0], np.where(beyond, unfolded(place[1], reads[1]), reads[1])
        if turned:
            place, reads = reads, place
        return replace(p, **dict(zip(('az', 'el', 'az_enc', 'el_enc'), (*place, *reads))))

    @staticmethod
    def _zeros_taken_off(_, places, zero, gain, lost):
        """Misfit with only the zeros fitted."""
        az, el, az_enc, el_enc, _ = places
        x, y = (az_enc - az) * np.cos(el), el_enc - el
        return misfit([scatter(v - np.median(v), 1.0) for v in (x, y)], gain)

    def _first_order(self, reading, places, zero, gain, lost):
        """Misfit with the terms fitted in first order, without robust weights."""
        az, el, az_enc, el_enc, _ = places
        x, y = (az_enc - az) * np.cos(el), el_enc - el
        try:
            with np.errstate(all='ignore'):
                fitted = fit_first_order(az, el, x, y, self.names.physical,
                                         mount=self._mount(reading))
        except (ValueError, np.linalg.LinAlgError):
            return -np.inf
        sigma = [scatter(v, 1.0) for v in fitted.residual.reshape(2, -1)]
        if np.hypot(*sigma) > _HOPELESS:
            return np.inf
        if reading.offsets and not _explained(places, zero, sigma, 0.3 * _OFFSETS_LIKELIER):
            return np.inf
        return misfit(sigma, gain)


def scatter(values, dof):
    """Robust and efficient noise estimate: RMS with residuals capped at 3 times the MAD
    (a tau scale, Yohai and Zamar 1988).
    """
    if not len(values):
        return np.nan
    middle = max(float(sigma_of(values)), 1e-5 * ARCSEC)
    bounded = np.minimum(np.square(values / middle), TAU**2)
    return max(middle * dof * float(np.sqrt(np.mean(bounded))), 1e-4 * ARCSEC)


def misfit(sigma, gain):
    """Mean logarithm of the noise of both axes, converted to units of the columns as written."""
    return 0.5 * (np.log(sigma[0] * sigma[1]) - gain)
