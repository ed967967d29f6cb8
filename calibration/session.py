"""What the calibration knows of a night: its observations, the zeros, the models, the report."""

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.model import PointingModel
from pointing_model.rms import rms_arcsec
from pointing_model.run import PointingRun
from pointing_model.star_catalogue import POLARIS_HIP
from pointing_model.terms import PHYSICAL
from pointing_model.zero import NO_ZERO, Zeros, zero_in_force

from .check import split_half
from .fit import fit_harmonics, fit_terms
from .polaris_zero import zero_from_polaris
from .rows import for_fitting, with_check
from .witnesses import check_witnesses

REPORT_FORMAT = 'telescope_mount/calibration_report'
REPORT_VERSION = 1

RAW = 'as the encoders read'
ZEROED = 'zero set on Polaris'
TERMS = f'{len(PHYSICAL)} physical terms'
BOTH = f'{TERMS}, then 13 harmonics'


#: label in the report -> what E is in paper 000's harmonics
HARMONICS = {
    '13 harmonics, E read as zenith distance': 'zenith',
    '13 harmonics, E read as printed': 'printed',
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
    yesterday : witnesses.Witness, optional
        How Polaris and the encoders stood to each other the night before.
    """

    def __init__(self, reference=None, split_seed=1, yesterday=None):
        self.reference = reference
        self._split_seed = split_seed
        self._yesterday = yesterday
        #: how Polaris and the encoders stand to each other tonight, from `fit` on
        self.witness = None
        self._parts = []
        self.last_stamp = 0
        #: that `fit` made last, PointingModel
        self.model = None
        #: by Polaris alone, a PolarisZero of each power-on with exposures
        self.zeros = Zeros()
        #: that belong to the fitted model
        self.zeros_in_force = Zeros()

    def __len__(self):
        return sum(len(part) for part in self._parts)

    @property
    def newest(self):
        """Number of the newest power-on; ValueError before the first row."""
        return int(self.observations()['run'].max())

    def add(self, run, stamp):
        """Take rows of the night; rows that are not newer than those here are known already.

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
        if stamp > self.last_stamp:
            self._parts.append(with_check(run))
            self.last_stamp = stamp

    def take_table(self, run, stamp):
        """Take the table of all rows so far, if there is more in it than here.

        Parameters
        ----------
        run : PointingRun
            All rows of the night.
        stamp : int
            Of the newest row, ns.
        """
        if stamp >= self.last_stamp and len(run) > len(self):
            self._parts.clear()
            self.last_stamp = 0
            self.add(run, stamp)

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
        zero : PolarisZero
            Its zero.

        Raises
        ------
        ValueError
            No usable exposure of Polaris in the newest power-on.
        """
        rows = self.observations()
        newest = self.newest
        polaris = rows.select(rows['star'] == POLARIS_HIP)
        reference = self.reference or PointingModel({})
        for number in np.unique(polaris['run']):
            part = polaris.select(polaris['run'] == number)
            self.zeros[int(number)] = zero_from_polaris(part, reference, run=int(number))
        if newest not in self.zeros:
            raise ValueError(f'Polaris was not observed since power-on {newest}; point at it first')
        return newest, self.zeros[newest]

    def fit(self, homings=()):
        """Fit all stars, and judge each kind of model on stars that it did not see.

        Rows with ``check`` 1 are left out: see `rows`.

        The terms are fitted together with the change of the zero from power-on to power-on, to
        stars and exposures of Polaris alike: Polaris fixes most of the change, the stars help.

        Parameters
        ----------
        homings : iterable of witnesses.Homing
            What the incremental encoders say of themselves.

        Returns
        -------
        model : PointingModel
            The physical terms, for pointing with `zeros_in_force`.
        report : dict
            See `REPORT_FORMAT`; JSON-ready.

        Raises
        ------
        ValueError
            Too few stars.
        """
        rows = self.observations()
        rows = for_fitting(rows)
        is_star = rows['star'] != POLARIS_HIP
        stars = rows.select(is_star)
        notes = []
        result, self.zeros_in_force = self._fit_terms(rows)
        for dropped in result.dropped:
            notes.append(f'the stars do not determine {dropped["text"]}')
        for row in result.excluded:
            notes.append(f'row {row["row"]} left out: {row["reason"]}')
        in_force = self.zeros_in_force.to_list()
        report = {
            'format': REPORT_FORMAT, 'version': REPORT_VERSION,
            'last_stamp_ns': self.last_stamp,
            'stars': len(stars), 'polaris': int(np.count_nonzero(~is_star)),
            'zeros': self.zeros.to_list(),
            'changes': self._changes(rows, result.model),
            'zeros_in_force': in_force,
            'terms': result.term_rows(),
            'correlations': result.correlations.tolist(),
            'condition': result.condition,
            'rejected': len(result.rejected),
            'steps': self._steps(rows, notes),
            'external_check': self._external(rows, notes),
            'noise_arcsec': [s / ARCSEC for s in result.scatter],
            'witnesses': self._witnesses(rows, result.model, homings),
            'notes': notes,
        }
        provenance = {
            **result.model.provenance, 'last_stamp_ns': self.last_stamp,
            'zeros_in_force': in_force, 'reference': self._source(),
        }
        model = PointingModel(result.model.terms, result.model.covariance, None, provenance,
                              result.model.geometry)
        self.model = model
        return model, report

    def diagnose(self, alpha=0.01, site=None):
        """What the fitted model lacks, and the model with it; see `session_diagnosis`.

        Parameters
        ----------
        alpha : float
            Chance that a clean night gets any effect.
        site : dict, optional
            ``latitude``, ``longitude`` in rad.

        Returns
        -------
        session_diagnosis.Amended
            Its zeros are `zeros_in_force` from now on.

        Raises
        ------
        ValueError
            Too few stars.
        """
        from .session_diagnosis import amend
        rows = self.observations()
        zeros = self.zeros_in_force
        if self.model is None:
            zeros = self._polaris_zeros(rows)
        provenance = {'last_stamp_ns': self.last_stamp, 'reference': self._source()}
        amended = amend(rows, zeros, self.model, provenance, alpha, site)
        self.zeros_in_force = amended.zeros
        return amended

    def _witnesses(self, rows, model, homings):
        found = check_witnesses(rows, self._yesterday, model=model, homings=homings)
        self.witness = found.latest
        return {'alarms': found.alarms, 'notes': found.notes}

    def _fit_terms(self, rows):
        """Terms, and the zero of each power-on that belongs to them."""
        from .diagnosis import check_columns
        check_columns(rows.select(rows['star'] != POLARIS_HIP))
        first = self._polaris_zeros(rows)[rows['run'].min()]
        result = fit_terms(rows, zero=first, run_zeros=True)
        return result, Zeros(zero.plus(first.az, first.el) for zero in result.run_zeros.values())

    def _polaris_zeros(self, rows):
        """Zero of each power-on by Polaris alone; where there is none, the one before it."""
        return self.zeros.carried(map(int, np.unique(rows['run'])), first=NO_ZERO)

    def _source(self):
        if self.reference is None:
            return None
        return self.reference.provenance.get('source', 'a model of an earlier night')

    def _changes(self, rows, model):
        """Change of the zero from each power-on to the next, by Polaris alone."""
        numbers = sorted(self.zeros)
        return [{'from': before, 'to': after, **self._change(rows, before, after, model).to_dict()}
                for before, after in zip(numbers, numbers[1:])]

    @staticmethod
    def _change(rows, before, after, model):
        """`model` says how the offset differs between the two places of Polaris on its circle."""
        polaris = rows.select(rows['star'] == POLARIS_HIP)
        then, now = (polaris.select(polaris['run'] == number) for number in (before, after))
        return zero_from_polaris(
            now, then, model=model, reference_name=f'power-on {before:.0f}')

    def _steps(self, rows, notes):
        """RMS on the stars used and on those held out, from no correction to the full model."""
        is_star = rows['star'] != POLARIS_HIP
        stars = rows.select(is_star)
        used = split_half(stars, self._split_seed)
        halves = {'used': stars.select(used), 'held_out': stars.select(~used)}
        seen = ~is_star  # Polaris, and the stars used
        seen[np.flatnonzero(is_star)[used]] = True
        base = self.reference or PointingModel({})
        polaris = self._polaris_zeros(rows)
        steps = []

        def judge(label, model, zero):
            steps.append({'step': label, **{
                name: _rms(model, half, zero) for name, half in halves.items()}})

        judge(RAW if self.reference is None else 'model of the earlier night', base,
              zero_in_force(self.reference))
        if self.zeros:
            judge(ZEROED, base, polaris)
        for label, interpretation in HARMONICS.items():
            try:
                judge(label, fit_harmonics(halves['used'], interpretation, zero=polaris).model,
                      polaris)
            except ValueError as err:
                notes.append(f'{label}: {err}')
        try:
            result, zeros = self._fit_terms(rows.select(seen))
            judge(TERMS, result.model, zeros)
            judge(BOTH, fit_harmonics(halves['used'], held=result.model, zero=zeros).model, zeros)
        except ValueError as err:
            notes.append(f'held-out check: {err}')
        return steps

    def _external(self, rows, notes):
        """The paper's check: coefficients of one power-on on the stars of the next."""
        stars = rows.select(rows['star'] != POLARIS_HIP)
        if not self.zeros:
            return []
        polaris = self._polaris_zeros(rows)
        if self.reference is not None:
            label = 'model of the earlier night on all stars of tonight'
            return [{'check': f'{label}, before Polaris',
                     **_rms(self.reference, stars, zero_in_force(self.reference))},
                    {'check': f'{label}, after Polaris', **_rms(self.reference, stars, polaris)}]
        out = []
        numbers = [n for n in np.unique(stars['run']) if int(n) in self.zeros]
        for before, after in zip(numbers, numbers[1:]):
            old = polaris[before]
            try:
                model = fit_terms(rows.select(rows['run'] == before), zero=old).model
            except ValueError as err:
                notes.append(f'external check: {err}')
                continue
            later = stars.select(stars['run'] == after)
            new = old.plus(*self._change(rows, before, after, model).angles)
            label = f'model of power-on {before:.0f} on the stars of power-on {after:.0f}'
            out.append({'check': f'{label}, with the old zero', **_rms(model, later, old)})
            out.append({'check': f'{label}, zero by Polaris', **_rms(model, later, new)})
        return out


def _rms(model, run, zero):
    return rms_arcsec(*model.residuals(run, zero=zero))._asdict()
