"""What the calibration knows of a night: its observations, the zeros, the models, the report."""

import numpy as np

from pointing_model.catalogue import POLARIS_HIP
from pointing_model.model import PointingModel
from pointing_model.run import PointingRun
from pointing_model.terms import PHYSICAL
from pointing_model.units import ARCSEC

from .check import split_half
from .fit import fit_harmonics, fit_terms, rms_arcsec
from .zero import PolarisExposures, zero_from_polaris

REPORT_FORMAT = 'telescope_mount/calibration_report'
REPORT_VERSION = 1

RAW = 'as the encoders read'
ZEROED = 'zero set on Polaris'
TERMS = f'{len(PHYSICAL)} physical terms'
BOTH = f'{TERMS}, then 13 harmonics'


def _harmonics(reading):
    def fit(run, zero):
        return fit_harmonics(run, reading, zero=zero)
    return fit


def _both(run, zero):
    return fit_harmonics(run, model=fit_terms(run, zero=zero).model, zero=zero)


#: label in the report -> fit(run, zero) -> FitResult
FITS = {
    '13 harmonics, E read as zenith distance': _harmonics('zenith'),
    '13 harmonics, E read as printed': _harmonics('printed'),
    TERMS: lambda run, zero: fit_terms(run, zero=zero),
    BOTH: _both,
}


class CalibrationSession:
    """Collects observations and computes from them alone; the same rows give the same numbers.

    Parameters
    ----------
    reference : PointingModel, optional
        Model of an earlier night. The zero is then the change since that night. Without it the
        zero is the whole offset at Polaris, in which IA and IE cannot be told from the other
        terms; what changed shows between two power-ons.
    split_seed : int
        Of the choice of the stars that are held out.
    """

    def __init__(self, reference=None, split_seed=1):
        self._reference = reference
        self._split_seed = split_seed
        self._parts = []
        self.last_stamp = 0
        self.zeros = {}

    def __len__(self):
        return sum(len(part) for part in self._parts)

    def add(self, run, stamp):
        """Take rows of the night.

        Parameters
        ----------
        run : PointingRun
            With columns `star` and `run`.
        stamp : int
            Of the newest row, ns.

        Raises
        ------
        ValueError
            A column is missing.
        """
        for name in ('star', 'run'):
            if name not in run:
                raise ValueError(f'observation without column {name}')
        self._parts.append(run)
        self.last_stamp = max(self.last_stamp, stamp)

    def observations(self):
        """All rows so far, a PointingRun.

        Raises
        ------
        ValueError
            There is none.
        """
        if not self._parts:
            raise ValueError('no observation has come yet; observe first')
        return PointingRun.concatenate(self._parts)

    def calibrate_zero(self):
        """Zeros of all power-ons in which Polaris was observed.

        Returns
        -------
        run : int
            The newest of them.
        zero : Zero
            Its zero.

        Raises
        ------
        ValueError
            No usable exposure of Polaris in the newest power-on.
        """
        rows = self.observations()
        newest = int(rows['run'].max())
        polaris = rows.select(rows['star'] == POLARIS_HIP)
        reference = self._reference or PointingModel({}, provenance={'source': 'no model'})
        for number in np.unique(polaris['run']):
            part = polaris.select(polaris['run'] == number)
            x, y = part.offsets()
            self.zeros[int(number)] = zero_from_polaris(part['az'], part['el'], x, y, reference)
        if newest not in self.zeros:
            raise ValueError(f'Polaris was not observed since power-on {newest}; point at it first')
        return newest, self.zeros[newest]

    def fit(self):
        """Fit all stars, and judge each kind of model on stars that it did not see.

        Returns
        -------
        model : PointingModel
            The physical terms from all stars, for pointing with the zero.
        report : dict
            See `REPORT_FORMAT`; JSON-ready.

        Raises
        ------
        ValueError
            Too few stars.
        """
        rows = self.observations()
        stars = rows.select(rows['star'] != POLARIS_HIP)
        notes = []
        zero = None
        if self.zeros:
            has_zero = np.isin(stars['run'], list(self.zeros))
            if not has_zero.all():
                notes.append(f'{np.count_nonzero(~has_zero)} stars left out: no zero since their '
                             'power-on')
                stars = stars.select(has_zero)
            zero = {float(number): z for number, z in self.zeros.items()}
        result = fit_terms(stars, zero=zero)
        for dropped in result.dropped:
            notes.append(f'the stars do not determine {dropped["text"]}')
        for row in result.excluded:
            notes.append(f'row {row["row"]} left out: {row["reason"]}')
        report = {
            'format': REPORT_FORMAT, 'version': REPORT_VERSION,
            'stars': len(stars), 'polaris': int(np.count_nonzero(rows['star'] == POLARIS_HIP)),
            'zeros': [{'run': number, **z.to_dict()} for number, z in self.zeros.items()],
            'changes': self._changes(rows, result.model),
            'terms': _terms(result),
            'correlations': result.correlations.tolist(),
            'condition': result.condition,
            'rejected': len(result.rejected),
            'steps': self._steps(stars, zero, notes),
            'external_check': self._external(stars, zero, notes),
            'noise_arcsec': [s / ARCSEC for s in result.scatter],
            'notes': notes,
        }
        provenance = {
            **result.model.provenance, 'last_stamp_ns': self.last_stamp,
            'zeros': report['zeros'], 'reference': self._source(),
        }
        model = PointingModel(result.model.terms, result.model.covariance, None, provenance,
                              result.model.geometry)
        return model, report

    def _source(self):
        if self._reference is None:
            return None
        return self._reference.provenance.get('source', 'a model of an earlier night')

    def _changes(self, rows, model):
        """Change of the zero from each power-on to the next, with the fitted model's help."""
        polaris = rows.select(rows['star'] == POLARIS_HIP)
        numbers = sorted(self.zeros)
        out = []
        for before, after in zip(numbers, numbers[1:]):
            then = PolarisExposures.from_run(
                polaris.select(polaris['run'] == before), name=f'power-on {before}')
            now = polaris.select(polaris['run'] == after)
            x, y = now.offsets()
            change = zero_from_polaris(now['az'], now['el'], x, y, then, model=model)
            out.append({'from': before, 'to': after, **change.to_dict()})
        return out

    def _steps(self, stars, zero, notes):
        """RMS on the stars used and on those held out, from no correction to the full model."""
        used = split_half(stars, self._split_seed)
        halves = {'used': used, 'held_out': ~used}
        base = self._reference or PointingModel({})
        steps = []

        def judge(label, model, the_zero):
            row = {'step': label}
            for name, mask in halves.items():
                row[name] = _rms(model, stars.select(mask), the_zero)
            steps.append(row)

        judge(RAW if self._reference is None else 'model of the earlier night', base, None)
        if zero is not None:
            judge(ZEROED, base, zero)
        for label, fit in FITS.items():
            try:
                judge(label, fit(stars.select(used), zero).model, zero)
            except ValueError as err:
                notes.append(f'{label}: {err}')
        return steps

    def _external(self, stars, zero, notes):
        """The paper's check: coefficients of one power-on on the stars of the next."""
        if zero is None:
            return []
        if self._reference is not None:
            label = 'model of the earlier night on all stars of tonight'
            return [{'check': f'{label}, before Polaris', **_rms(self._reference, stars, None)},
                    {'check': f'{label}, after Polaris', **_rms(self._reference, stars, zero)}]
        out = []
        numbers = [n for n in sorted(zero) if np.any(stars['run'] == n)]
        for before, after in zip(numbers, numbers[1:]):
            try:
                model = fit_terms(stars.select(stars['run'] == before), zero=zero[before]).model
            except ValueError as err:
                notes.append(f'external check: {err}')
                continue
            later = stars.select(stars['run'] == after)
            label = f'model of power-on {before:.0f} on the stars of power-on {after:.0f}'
            out.append({'check': f'{label}, with the old zero',
                        **_rms(model, later, zero[before])})
            out.append({'check': f'{label}, with its own zero',
                        **_rms(model, later, zero[after])})
        return out


def _rms(model, run, zero):
    return rms_arcsec(*model.residuals(run, zero=zero))._asdict()


def _terms(result):
    return [{'name': name, 'value_arcsec': float(value) / ARCSEC,
             'sigma_arcsec': float(sigma) / ARCSEC}
            for name, value, sigma in zip(result.names, result.coefficients, result.sigma)]
