"""Whether the columns of a run are what they are named, told before anything is concluded.

The seven physical terms are fitted robustly to the run as written and in other readings
(`readings`). A misfit is a robust scatter, and those of two readings compare as likelihoods do:
each divided by what its offsets on the sky gain from a unit of the columns as written.
"""

from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import numpy as np

from calibration.fit import fit_first_order, fit_terms
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.mounts import is_beyond, through_pole
from pointing_model.run import PointingRun
from pointing_model.run_files import NoUsableRow

from .file_rows import FileRows
from .misfit import misfit, scatter
from .readings import MIRRORED, SOUTH, Reading, double_readings, single_readings
from .usual_effects import USUAL

#: arcsec, robust and radial. Beyond it no terms describe a run as written: of 73 measured runs one
#: leaves 37, the next 13; a loose mount of an amateur 90.
ABSURD = 1800.0
#: arcsec; a reading that leaves less than a detector could see, or more than any mount, is no fit
_FITS = (0.05, 600.0)
#: part of the rows that may lie where no telescope looks, and part that may be left out of a
#: diagnosis that claims an effect
MOST_LEFT_OUT = 1.0 / 3.0
#: how many times better, and by which log-likelihood, another reading must fit a run that would
#: pass as written. Of 73 measured runs none is read otherwise beyond 0.8 times as well, but for a
#: bad night (1.7 times; the effects below do so too). With zenith distances in both pairs 67 of 70
#: runs of three telescopes are told; the other three have 2, 15 and 46 rows.
_BETTER, _LIKELIER = 1.25, 15.0
#: the same where common effects are fitted too (`USUAL`)
_BETTER_WITH_EFFECTS, _LIKELIER_WITH_EFFECTS = 1.15, 10.0
#: of `USUAL` the run as written may have so many in place of a mistake
_MOST_EFFECTS = 2
#: times the best misfit, or log-likelihood, within which two readings cannot be told apart
_ALIKE, _AS_LIKELY = 1.05, 3.0
_NEAR = 3.0  # times the best misfit in first order, of readings of a run that fits as written
_TRIED = 16  # readings with two mistakes, of many that are alike at first sight
_FEW = 6  # rows that fits of seven terms begin with
_STEEPEST = 20.0 * DEG  # terms beyond, but for the zeros, belong to no mount
_HALF_A_QUARTER = 45.0 * DEG  # the second zero of a reading: beyond, it is another reading
_LIMITS = (-5.0 * DEG, 90.1 * DEG)
_DAY = 18.0  # hours that azimuths in hours span
_ZENITH = 89.0 * DEG  # no run has most of its rows beyond
_FIELD = 2.0 * DEG  # a run within it tells nothing of its columns


class MistakenColumns(ValueError):
    """The columns of a run are not what they are named.

    Parameters
    ----------
    text : str
        One line.
    readings : list of dict
        ``reading`` and ``rms_arcsec`` of those that fit, the best first.
    rows_read, rows_used : int
        As written.
    """

    def __init__(self, text, readings=(), rows_read=0, rows_used=0):
        super().__init__(text)
        self.readings, self.rows_read, self.rows_used = list(readings), rows_read, rows_used


@dataclass
class Checked:
    """What the check of a sound run says.

    Attributes
    ----------
    alike : list of str
        Readings that fit as well.
    notes : list of str
    """

    alike: list = field(default_factory=list)
    notes: list = field(default_factory=list)


def check_columns(runs, encoder='enc'):
    """See that the columns of runs are what they are named.

    Parameters
    ----------
    runs : PointingRun or sequence of PointingRun
        Each is judged alone, by what the columns of its file hold (``meta['as_written']``).
    encoder : {'enc', 'abs'}

    Returns
    -------
    Checked

    Raises
    ------
    MistakenColumns
        The run as written does not fit, or another reading fits far better.
    """
    runs = [runs] if isinstance(runs, PointingRun) else list(runs)
    each = [_Columns(run, encoder).judged() for run in runs if f'az_{encoder}' in run]
    alike = [text for text in dict.fromkeys(t for one in each for t in one.alike)
             if all(text in one.alike for one in each)]
    return Checked(alike, [note for one in each for note in one.notes])


@contextmanager
def naming_columns():
    """What is read within: a file of which no row can be used is told by what its columns are.

    Raises
    ------
    MistakenColumns
        In place of `NoUsableRow`, if a reading fits.
    """
    try:
        yield
    except NoUsableRow as error:
        if error.run is not None:
            check_columns(error.run)
        raise


@dataclass
class _Fit:
    """Of one reading: noise of the axes (radians), logarithm of the misfit, zeros of both axes."""

    reading: Reading
    places: tuple
    sigma: np.ndarray
    misfit: float
    zero: float
    second_zero: float
    terms: tuple
    names: object

    @property
    def rms_arcsec(self):
        return float(np.hypot(*self.sigma)) / ARCSEC

    @property
    def text(self):
        return self.reading.text(self.zero, self.names)

    def better_than(self, other):
        """How many times, and by which log-likelihood (of both axes)."""
        gain = other.misfit - self.misfit
        return np.exp(gain), 2.0 * len(self.places[0]) * gain


class _Columns:
    """The four columns of a run, every row that has numbers in them."""

    def __init__(self, run, encoder):
        self.rows = rows = FileRows(run, encoder)
        self.where, self.columns, self.label, self.held = (rows.where, rows.columns, rows.label,
                                                           rows.held)
        self.mount, self.lst = rows.mount, rows.lst
        self.physical, self.effects = rows.mount.names.physical, USUAL[rows.mount.kind]

    def judged(self):
        """`Checked`; raises MistakenColumns."""
        if len(self.label) < _FEW or self._in_a_field():
            return Checked()
        written = self._fit(Reading(), centred=False)
        far = self.rows.misplaced > MOST_LEFT_OUT * self.rows.rows_read
        if written is None or written.rms_arcsec > ABSURD or far:
            self._explain(written, far)
            return Checked()
        south = self.mount.altaz and abs(np.remainder(written.zero, 2.0 * np.pi) - np.pi) < SOUTH
        others = self._fits([r for r in self._single() if r != MIRRORED], _NEAR)
        if south:
            self._refuse(written, [self._fit(Reading())])
        # the mirror image of a mount is one, to the last digit: no fit is needed
        out, alike = Checked(), [] if self.held else [MIRRORED.text(names=self.mount.names)]
        for other in others:
            times, likelier = other.better_than(written)
            if times > _BETTER and likelier > _LIKELIER and other.rms_arcsec < _FITS[1]:
                if self._fills_the_day(other.reading) or self._needed(other, written):
                    self._refuse(written, _alike(others))
                if other.rms_arcsec < written.rms_arcsec / _BETTER:
                    out.notes.append(
                        f'{self.where}{other.text} would fit to {other.rms_arcsec:.1f} '
                        f'arcsec, where the seven terms leave {written.rms_arcsec:.1f}; an effect '
                        'that they lack may do so too: make sure of the columns')
            elif times > 1.0 / _ALIKE or likelier > -_AS_LIKELY:
                alike.append(other.text)
        out.alike = alike
        return out

    def _single(self):
        return single_readings(self.held, self.mount, self.lst is not None)

    def _in_a_field(self):
        """Whether the catalogue places are as good as one place, however they are read."""
        return all(np.ptp(c) < _FIELD for c in self.columns[:2])

    def _fits(self, readings, near=10.0):
        """Fits of the readings that come near the best at first sight, best first.

        `near`: how many times the best misfit in first order.
        """
        seen = [(reading, sight) for reading in readings if self._plausible(reading)
                for sight in (self._places(reading, True),) if sight is not None]
        for look, times in ((self._zeros_taken_off, 10.0), (self._first_order, near)):
            misfits = [look(*sight) for _, sight in seen]
            least = min(misfits, default=0.0) + np.log(times)
            ranked = sorted(zip(misfits, range(len(seen))))
            seen = [seen[i] for misfit, i in ranked if misfit <= least]
        near = [reading for reading, _ in seen]
        single = [reading for reading in near if reading.mistakes < 2]
        double = [reading for reading in near if reading.mistakes == 2][:_TRIED]
        fits = [fit for fit in map(self._fit, single + double)
                if fit is not None and abs(fit.second_zero) < _HALF_A_QUARTER]
        return sorted(fits, key=lambda fit: fit.misfit)

    def _plausible(self, reading):
        """Whether the numbers lie in the range of such a reading."""
        for names, (az, el) in ((reading.catalogue, self.columns[:2]),
                                (reading.encoders, self.columns[2:])):
            if not _in_range(names, az / DEG, el / DEG):
                return False
            if not self._says_something(names):
                return False
        return True

    def _says_something(self, names):
        """Whether a reading of the side of the pier is another one than that as written."""
        az, _, az_enc, el_enc = self.columns
        beyond = is_beyond(el_enc)
        return not ('ascension' in names and 'hours' in names
                    or 'unturned' in names and not beyond.any()
                    or 'folded' in names and not (np.cos(az_enc - az) < 0.0).any()
                    or 'sideless' in names and (beyond.any() or self.rows.beyond is not None
                                                or self.mount.kind != 'german'))

    def _fills_the_day(self, reading):
        """Whether azimuths run over 0 to 24, as no dome's slit does, and are read as hours."""
        az = self.columns[0] / DEG
        return (self.mount.altaz and 'hours' in reading.catalogue
                and 'swapped' not in reading.catalogue and az.min() >= 0.0 and np.ptp(az) > _DAY)

    def _places(self, reading, centred):
        """Usable places of a reading, the azimuth zero taken off, and the log of its gain."""
        with np.errstate(invalid='ignore', over='ignore', divide='ignore'):
            p = reading.places(*self.columns, held=self.held, lst=self.lst)
            p, mount = self._by_axes(p, reading), _mount_of(reading, self.mount)
            high = p.el if mount.altaz and self.rows.beyond is None else mount.horizon_of(
                p.az, p.el)[1]
            good = np.isfinite(p.az_enc + p.el_enc) & (high >= _LIMITS[0]) & (high <= _LIMITS[1])
        if good.sum() < _FEW or good.mean() < 1.0 - MOST_LEFT_OUT:
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
        return (az, el, az_enc, el_enc, self.label[good]), zero, float(
            np.mean(np.log(np.maximum(gain, 1e-9))))

    def _by_axes(self, p, reading):
        """Places as angles of the axes, each on the side that its reading is on.

        That is, as `run_files.places.to_axes` has it, what the readings say, else a column.
        """
        if self.mount.altaz and self.rows.beyond is None:
            return p
        az_enc, el_enc, beyond = p.az_enc, p.el_enc, self.rows.beyond
        if reading.exchanged:
            beyond = is_beyond(p.el)
        if beyond is not None and not is_beyond(el_enc).any():
            az_enc, el_enc = through_pole(az_enc, el_enc, beyond)
        az, el = through_pole(p.az, p.el, is_beyond(p.el) != is_beyond(el_enc))
        return replace(p, az=az, el=el, az_enc=az + wrap(az_enc - az),
                       el_enc=el + wrap(el_enc - el))

    @staticmethod
    def _zeros_taken_off(places, _, gain):
        """Misfit with nothing but the zeros fitted."""
        az, el, az_enc, el_enc, _ = places
        x, y = (az_enc - az) * np.cos(el), el_enc - el
        return misfit([scatter(v - np.median(v), 1.0) for v in (x, y)], gain)

    def _first_order(self, places, _, gain):
        """Misfit with the terms fitted in first order, not robustly."""
        az, el, az_enc, el_enc, _ = places
        x, y = (az_enc - az) * np.cos(el), el_enc - el
        try:
            fitted = fit_first_order(az, el, x, y, self.physical, mount=self.mount)
        except (ValueError, np.linalg.LinAlgError):
            return -np.inf
        return misfit([scatter(v, 1.0) for v in (fitted.residual_x, fitted.residual_y)], gain)

    def _fit(self, reading, centred=True, terms=None):
        terms, index = terms or self.physical, self.mount.names.index
        found = self._places(reading, centred)
        if found is None:
            return None
        places, zero, gain = found
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
                fitted = fit_terms(PointingRun(columns, {'mount': self.mount}), terms,
                                   run_zeros=several)
        except (ValueError, np.linalg.LinAlgError):
            return None
        if any(abs(v) > _STEEPEST for t, v in fitted.model.terms.items() if t not in index):
            return None
        dof = np.sqrt(2.0 * n / (2.0 * n - count))
        sigma = np.array([scatter(r[np.isfinite(r)], dof)
                          for r in (fitted.residual_x, fitted.residual_y)])
        if not np.isfinite(sigma).all():
            return None
        return _Fit(reading, places, sigma, misfit(sigma, gain),
                    zero + fitted.model.terms[index[0]], fitted.model.terms[index[1]], terms,
                    self.mount.names)

    def _needed(self, other, written):
        """Whether common effects in place of the other reading do not fit as well.

        Either some in the run as written, against none in the other, or all in both.
        """
        terms, amended = self.physical, written
        for _ in range(_MOST_EFFECTS):
            fits = [fit for fit in (self._fit(Reading(), False, terms + group)
                                    for group in self.effects if group[0] not in terms)
                    if fit is not None]
            if fits:
                amended = min([amended, *fits], key=lambda fit: fit.misfit)
                terms = amended.terms
        if _far_better(other, amended):
            return True
        most = (2 * len(written.places[0]) - 8) * 2 // 3
        terms = self.physical
        for group in self.effects:
            terms += group if len(terms + group) <= most else ()
        fits = [self._fit(Reading(), False, terms), self._fit(other.reading, True, terms)]
        return None not in fits and _far_better(fits[1], fits[0])

    def _explain(self, written, far):
        """Refuse what does not fit as written; return where its rows fit but are too few."""
        fits = self._fits([Reading(), *self._single(), *double_readings(
            self.held, self.mount, self.lst is not None)])
        fits = _alike([fit for fit in fits if _FITS[0] < fit.rms_arcsec < _FITS[1]])
        if fits or not far or written is None or written.rms_arcsec > ABSURD:
            self._refuse(written, fits)

    def _refuse(self, written, fits):
        left = 'do not fit' if written is None else f'leave {_size(written.rms_arcsec)}'
        what = ('the columns are not what they are named' if fits
                else 'catalogue and encoders do not belong together')
        used, read = self.rows.rows_used, self.rows.rows_read
        text = f'{self.where}{what}: {used} of {read} rows can be used as written, and {left}'
        said = '; '.join(f'{fit.text} ({_size(fit.rms_arcsec)})' for fit in fits)
        if len(fits) > 1:
            text += f'. These readings fit, and cannot be told apart: {said}'
        elif fits:
            text += f'. Read otherwise they fit: {said}'
        else:
            text += '. No other reading that was tried fits'
        raise MistakenColumns(
            text + '. Nothing was concluded; '
            + ('set the columns right' if fits else 'look at the columns and at the rows'),
            [{'reading': fit.text, 'rms_arcsec': fit.rms_arcsec} for fit in fits],
            read, used)


def _in_range(names, az, el):
    """Whether numbers may be angles in the unit of a reading."""
    if 'swapped' in names:
        az, el = el, az
    widest = max(np.abs(az).max(), np.abs(el).max())
    return not (
        'arcseconds' in names and widest < 720.0 or 'arcminutes' in names and widest < 360.0
        or 'gradians' in names and not (np.abs(az).max() <= 400.5 and np.abs(el).max() <= 300.5)
        or 'radians' in names and widest > 2.0 * np.pi
        or 'radians of the first' in names and np.abs(az).max() > 2.0 * np.pi
        or 'hours' in names and not (az.max() <= 24.5 and az.min() >= -12.5))


def _mount_of(reading, mount):
    return getattr(reading, 'mount', mount)


def _far_better(fit, other):
    times, likelier = fit.better_than(other)
    return times > _BETTER_WITH_EFFECTS and likelier > _LIKELIER_WITH_EFFECTS


def _alike(fits):
    """The best and those that cannot be told from it; of these the ones with fewest mistakes."""
    near = []
    for fit in fits:
        times, likelier = fit.better_than(fits[0])
        if times > 1.0 / _ALIKE or likelier > -_AS_LIKELY:
            near.append(fit)
    fewest = min((fit.reading.mistakes for fit in near), default=0)
    return [fit for fit in near if fit.reading.mistakes == fewest]


def _size(arcsec):
    return f'{arcsec:.1f} arcsec' if arcsec < 3600.0 else f'{arcsec / 3600.0:.1f} deg'
