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

"""The terms of a mount fitted to the rows of a file in other readings than as they are written."""

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

#: part of the rows that may lie where no telescope looks, and part that may be left out of a
#: diagnosis that claims an effect
MOST_LEFT_OUT = 1.0 / 3.0
TAU = 3.0  # standard deviations, from where a residual counts no more
FEW = 6  # rows that fits of seven terms begin with
_TRIED = 16  # readings with two mistakes, of many that are alike at first sight
_CLOCKS = 4  # of other clocks and sites
_STEEPEST = 20.0 * DEG  # terms beyond, but for the zeros, belong to no mount
_HALF_A_QUARTER = 45.0 * DEG  # the second zero of a reading: beyond, it is another reading
_LIMITS = (-5.0 * DEG, 90.1 * DEG)
_HOPELESS = 5.0 * DEG  # left in first order, far more than steep terms leave
_ZENITH = 89.0 * DEG  # no run has most of its rows beyond
_ONE_SIDE = 0.99  # length of the mean of unit vectors of the first axis' offsets: all alike
_LOST = 7.0  # log-likelihood of a row that a reading has where no telescope looks
#: rad, and logarithms: of sizes that are all likely alike, from small ones on
_SMALL, _MOST_OF_SIZES = 10.0 * ARCSEC, 8.0
#: times its noise that numbers taken for offsets are larger, or log-likelihood that they gain by
#: the terms: else nothing says that they are offsets
_OFFSETS_LARGER, _OFFSETS_LIKELIER = 5.0, 15.0


@dataclass
class ReadingFit:
    """Of one reading.

    Attributes
    ----------
    reading : Reading or MovedRun
    places : tuple of ndarray, shape (n,)
        Catalogue, readings, number of the run.
    taken : float
        The first zero that was taken off the readings before the fit, radians.
    sigma : ndarray, shape (2,)
        Noise of both axes, radians.
    freedom : int
        Offsets beyond what was fitted.
    misfit : float
        Mean logarithm of the noise, see `misfit`.
    lost : int
        Rows that it has where no telescope looks.
    zeros : tuple of float
        Of both axes, radians.
    tilt : float
        Of the first axis, radians.
    terms : tuple of str
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
        """Radial."""
        return float(np.hypot(*self.sigma)) / ARCSEC

    @property
    def text(self):
        """What it reads, for people."""
        return self.reading.text(self.zeros[0], self.names)

    def better_than(self, other):
        """How many times, and by which log-likelihood (of both axes, and of rows without a place).

        Of another clock or site the sizes of zero and tilt count too: they are as likely to be of
        one size as of ten times that.
        """
        gain = other.misfit - self.misfit
        likelier = min(self.freedom, other.freedom) * gain + _LOST * (other.lost - self.lost)
        if self.reading.elsewhere:
            likelier += sum(np.clip(np.log(max(b, _SMALL) / max(a, _SMALL)), -_MOST_OF_SIZES,
                                    _MOST_OF_SIZES) for a, b in zip(self.sizes, other.sizes))
        return np.exp(gain), likelier

    def as_good_as(self, other, least, likeliest):
        """Whether it is at most so many times worse and loses no row more, or so much less likely.
        """
        times, likelier = self.better_than(other)
        return likelier > -likeliest or (
            times > 1.0 / least and self.lost <= other.lost and not self.reading.elsewhere)

    @property
    def sizes(self):
        """Of the first zero and of the tilt, radians."""
        return abs(wrap(self.zeros[0])), self.tilt

    def far_better_than(self, other, least, likeliest):
        """Whether it is so many times better, or has rows that the other loses, and likelier."""
        times, likelier = self.better_than(other)
        return likelier > likeliest and (times > least or self.lost < other.lost
                                         or self.reading.elsewhere)

    def explains(self):
        """Whether numbers that are read as offsets are more than their scatter, or follow terms."""
        return not self.reading.offsets or _explained(self.places, self.taken, self.sigma,
                                                      _OFFSETS_LIKELIER)


def _explained(places, taken, sigma, likelier):
    """Whether offsets are larger than what terms leave, or are left less by them than by zeros.

    Any numbers fit as offsets in a small unit.
    """
    az, el, az_enc, el_enc, _ = places
    x, y = (az_enc - az + taken) * np.cos(el), el_enc - el
    columns = np.stack((np.cos(el), np.ones(len(el))), axis=-1)
    by_zeros = x - columns @ np.linalg.lstsq(columns, x, rcond=None)[0], y - np.median(y)
    size = [np.sqrt(np.median(np.square(v))) for v in (x, y)]
    gain = len(az) * float(np.sum(np.log(np.divide([scatter(v, 1.0) for v in by_zeros], sigma))))
    return bool(np.prod(np.divide(size, sigma)) > _OFFSETS_LARGER**2 or gain > likelier)


class ReadingFits:
    """Fits to the rows of a file in other readings.

    Parameters
    ----------
    rows : FileRows
    """

    def __init__(self, rows):
        self.rows, self.names = rows, rows.mount.names

    def fit(self, reading, centred=True, terms=None):
        """The robust fit of one reading, a `ReadingFit`, or None where it has none.

        Parameters
        ----------
        reading : Reading or MovedRun
        centred : bool
            The first zero is taken off before the fit.
        terms : tuple of str, optional
            By default the seven of the mount.
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
        """Fits of the readings that come near the best at first sight, best first.

        Parameters
        ----------
        readings : sequence of Reading or MovedRun
        near : float
            How many times the best misfit in first order.

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
        """Whether the numbers lie in the range of such a reading, and it is another one."""
        az, el, az_enc, el_enc = self.rows.columns
        if not (in_range(reading.catalogue, az, el) and in_range(reading.encoders, az_enc, el_enc)):
            return False
        beyond = read_beyond(self.rows.mount, (az, el), (az_enc, el_enc),
                             np.isfinite(az_enc + el_enc))
        names = reading.encoders
        return not (
            'ascension' in (*names, *reading.catalogue) and 'hours' in (*names, *reading.catalogue)
            or 'unturned' in names and not beyond.any()
            or 'folded' in names and abs(np.exp(1j * (az_enc - az)).mean()) > _ONE_SIDE
            or 'sideless' in names and (beyond.any() or self.rows.beyond is not None
                                        or not self.rows.mount.two_sided))

    def _places(self, reading, centred):
        """Usable places of a reading, the first zero taken off, the log of its gain, rows lost."""
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
        """Places as angles of the axes, each on the side that its reading is on.

        That is, as `run_files.places.to_axes` has it, what the readings say, else a column.
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
        """The same of an alt-azimuth mount, as `run_files.places.past_zenith` has it."""
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
        """Misfit with nothing but the zeros fitted."""
        az, el, az_enc, el_enc, _ = places
        x, y = (az_enc - az) * np.cos(el), el_enc - el
        return misfit([scatter(v - np.median(v), 1.0) for v in (x, y)], gain)

    def _first_order(self, reading, places, zero, gain, lost):
        """Misfit with the terms fitted in first order, not robustly."""
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
    """Robust noise with little noise of its own: root mean square, of large ones 3 times the MAD
    (a tau scale, Yohai and Zamar 1988).
    """
    if not len(values):
        return np.nan
    middle = max(float(sigma_of(values)), 1e-5 * ARCSEC)
    bounded = np.minimum(np.square(values / middle), TAU**2)
    return max(middle * dof * float(np.sqrt(np.mean(bounded))), 1e-4 * ARCSEC)


def misfit(sigma, gain):
    """Mean logarithm of the noise of both axes, in units of the columns as written."""
    return 0.5 * (np.log(sigma[0] * sigma[1]) - gain)
