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

"""Interface for Python programs: read a pointing run, fit, diagnose, apply a model. No ROS.

::

    from telescope_mount import read_run, fit, diagnose, apply

    run = read_run('run.csv')
    print(fit(run))
    found = diagnose(run)
    az_enc_deg, el_enc_deg = apply(found, 120.0, 45.0)

These are the commands of the same names without their output: the same file gives the same
numbers. Names of results include the unit: ``_deg``, ``_arcsec``, ``_c``, ``_hpa``, ``_m``;
offsets are encoder - catalogue, on the sky. Each result has the underlying object of the package,
in radians (`Run.rows`, `Fit.result`, `RunDiagnosis.result`).

The names here are stable: they keep their meaning and unit within a major version.
"""

from functools import cached_property, wraps
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from threadpoolctl import threadpool_limits

from calibration.analysis.diagnosis.diagnosis import diagnose as _diagnose
from calibration.analysis.diagnosis.mistaken_columns import check_columns
from calibration.analysis.run_fit import fit_run
from calibration.analysis.sky_model import settled_together
from calibration.estimation.false_alarms import ALPHA
from calibration.report.documents import fit_document, run_diagnosis_document
from calibration.report.wording import paragraph, wording
from msg_tools.units import ARCSEC, DEG
from msg_tools.whole_files import write_text
from pointing_model.model_application import apply
from pointing_model.runs.copies import without_copies
from pointing_model.runs.run import COLUMNS, PointingRun, column_name

from .commands.options import names, place_of
from .input_files.run_loader import load_run

__all__ = ['Fit', 'Run', 'RunDiagnosis', 'apply', 'diagnose', 'fit', 'read_run']


def _one_thread(work):
    """Run without threads of BLAS: our matrices are small, so threads only slow each other down. A
    diagnosis of 80 rows takes four times as long, and its last bits differ from the command's.
    """
    @wraps(work)
    def limited(*args, **options):
        with threadpool_limits(1):
            return work(*args, **options)
    return limited


class Run:
    """A pointing run: its columns by their names in a CSV file, with the unit.

    ``run['az_deg']``, ``run['el_enc_deg']``, ``run['temperature_c']``, ``run['time']`` (UTC,
    seconds since 1970), for equatorial mounts ``run['ha_deg']``; `COLUMNS` of
    `pointing_model.runs.run` lists them all.

    Attributes
    ----------
    rows : pointing_model.runs.run.PointingRun
        The same in radians.
    """

    def __init__(self, rows):
        self.rows = rows
        self._names = {column_name(name, rows.mount.names): name for name in rows.columns}

    def __len__(self):
        return len(self.rows)

    def __contains__(self, name):
        return name in self._names

    def __getitem__(self, name):
        """Column `name` in the unit of its name, shape (n,)."""
        if name not in self._names:
            raise KeyError(f'no column {name}; the run has {", ".join(self.names)}')
        inside = self._names[name]
        values, unit = self.rows[inside], COLUMNS.get(inside, ('', 1.0))[1]
        return values / unit if unit != 1.0 else values

    @property
    def names(self):
        """Names of the columns, list of str."""
        return list(self._names)

    @property
    def notes(self):
        """Notes from the reader of the file, list of str."""
        return list(self.rows.meta.get('notes', ()))

    def select(self, rows):
        """The run with only these rows (a mask or indices)."""
        return Run(self.rows.part(rows, lines=self.rows.lines[rows]))

    def __repr__(self):
        source = Path(str(self.rows.meta.get('source', ''))).name
        return f'<Run {source}: {len(self)} rows, {self.rows.mount.kind}>'


class _Found:
    """Common part of `Fit` and `RunDiagnosis`: their `result`."""

    @property
    def model(self):
        """The `pointing_model.model.PointingModel`, with the effects found."""
        return self.result.model

    @property
    def used(self):
        """Rows that were used and are not outliers, ndarray of bool, shape (n,)."""
        return self.result.weights > 0.0

    @property
    def rms_before_arcsec(self):
        """Radial RMS on the sky, arcsec: of the raw errors, for a diagnosis of its terms alone."""
        return self.document['before']['rms_arcsec']

    def save(self, path):
        """Write the model (.json, .yaml), like ``--save`` of the command."""
        self.model.save(path)


class Fit(_Found):
    """Result of `fit`.

    Attributes
    ----------
    run : Run
    result : calibration.analysis.fit_result.FitResult
        In radians.
    document : dict
        Output of ``telescope-mount fit --json``.
    """

    def __init__(self, run, result, document):
        self.run, self.result, self.document = run, result, document

    @property
    def terms_arcsec(self):
        """Term -> value, encoder - catalogue, arcsec; dict of str to float."""
        return {row['name']: row['value_arcsec'] for row in self.document['terms']}

    @property
    def sigmas_arcsec(self):
        """Term -> standard error, arcsec; dict of str to float, None for `undetermined` ones."""
        return {row['name']: row['sigma_arcsec'] for row in self.document['terms']}

    @property
    def undetermined(self):
        """Terms that the stars do not determine, tuple of str.

        Those that are not fixed at zero stand for the sum of all of them on these stars.
        """
        return self.result.undetermined

    @property
    def rms_arcsec(self):
        """Radial RMS on the sky of the fitted rows, arcsec."""
        return self.document['after']['rms_arcsec']

    @property
    def rms_left_out_arcsec(self):
        """Radial RMS of 2-fold cross-validation, arcsec; None: too few rows."""
        return self.document['after']['cv_rms_arcsec']

    @property
    def residuals_arcsec(self):
        """Residuals on the sky along both axes, arcsec, shape (2, n); NaN: row not used."""
        return np.array((self.result.residual_x, self.result.residual_y)) / ARCSEC

    def __repr__(self):
        sigmas = self.sigmas_arcsec
        terms = ''.join(f'{name:>8} {value:+10.2f} ' + (
            'undetermined' if sigmas[name] is None else f'± {sigmas[name]:.2f}"') + '\n'
            for name, value in self.terms_arcsec.items())
        return (f'{terms}{self.document["observations"]} of {len(self.run)} rows, RMS on the sky '
                f'{self.rms_before_arcsec:.2f}" -> {self.rms_arcsec:.2f}"')


class RunDiagnosis(_Found):
    """Result of `diagnose`.

    Attributes
    ----------
    result : calibration.analysis.diagnosis.diagnosis_result.Diagnosis
        In radians.
    """

    def __init__(self, result):
        self.result = result

    @cached_property
    def document(self):
        """Output of ``telescope-mount diagnose --json``, dict."""
        return run_diagnosis_document(self.result)

    @property
    def verdict(self):
        """'none', 'wanders', 'undecided', 'identified', 'ambiguous', 'unknown' or 'refused'."""
        return self.result.verdict

    @property
    def sentences(self):
        """The verdict for people: a headline and its consequences; list of str."""
        from calibration.report.effect_wording import effect_summaries
        from calibration.report.verdict_wording import verdict_sentences
        headline, more = verdict_sentences(self.document, effect_summaries(self.result),
                                           caution=paragraph(self.result.cautions))
        return [headline, *more]

    @property
    def effects(self):
        """One dict per effect: ``name``, ``coefficients_arcsec``, ``p_family``, ..."""
        return self.document['effects']

    @property
    def rms_after_arcsec(self):
        """The same with the effects, arcsec."""
        return self.document['after']['rms_arcsec']

    @property
    def rms_left_out_arcsec(self):
        """Cross-validated RMS before and after (effects re-selected), arcsec; None: unknown."""
        return tuple(self.document[when]['cv_rms_arcsec'] for when in ('before', 'after'))

    @property
    def residuals_before_arcsec(self):
        """Residuals of the declared model on the sky along both axes, arcsec, shape (2, n)."""
        return self.result.residual_before / ARCSEC

    @property
    def residuals_after_arcsec(self):
        """Residuals with the effects, arcsec, shape (2, n)."""
        return self.result.residual_after / ARCSEC

    @property
    def az_deg(self):
        """First angle of the catalogue places of the residuals, degrees, shape (n,)."""
        return self.result.observations.run['az'] / DEG

    @property
    def el_deg(self):
        """Second angle of the catalogue places of the residuals, degrees, shape (n,)."""
        return self.result.observations.run['el'] / DEG

    def write_page(self, path):
        """Write the HTML page, like ``diagnose --report``."""
        from calibration.report.diagnosis_page import render
        from calibration.report.diagnosis_view import view_of
        write_text(path, render(view_of(self.result, self.document)))

    def __repr__(self):
        return '\n'.join(self.sentences)


def read_run(path, *, mount=None, latitude_deg=None, longitude_deg=None, height_m=None,
             pressure_hpa=None, temperature_c=None, azimuth_origin=None, equinox=None):
    """Read a pointing run from any file that the commands accept, or from a log.

    Parameters
    ----------
    path : str or Path
        CSV, TPOINT, TheSky, MMT, IRAM, MountWizzard4, gpoint, ... or the folder of a log: see
        `pointing_model.runs.formats.read_run`.
    mount : str, optional
        ``altaz``, ``equatorial``, ``german``, ``xy[:AZ]`` or ``free:AZ,EL[,ROLL]``; overrides
        the file.
    latitude_deg, longitude_deg, height_m : float, optional
        Site (degrees, east positive; metres), if the file does not give it.
    pressure_hpa, temperature_c : float, optional
        Weather, for the refraction of places in right ascension.
    azimuth_origin : {'N', 'S'}, optional
        Where azimuth 0 is in a TPOINT file.
    equinox : {'j2000', 'date'}, optional
        Equinox of right ascensions; by default from the file, or the one that fits.

    Returns
    -------
    Run

    Raises
    ------
    ValueError
        Not a pointing run; one line says what is wrong, where, and what to do.
    OSError
        It cannot be read.
    """
    place = place_of(SimpleNamespace(
        azimuth_origin=azimuth_origin, mount=mount, latitude=latitude_deg,
        longitude=longitude_deg, height=height_m, pressure=pressure_hpa,
        temperature=temperature_c, equinox=equinox))
    return Run(load_run(path, **place))


@_one_thread
def fit(run, terms=None, *, encoder='enc', robust=True):
    """Fit pointing terms.

    Parameters
    ----------
    run : Run, PointingRun, str or Path
        A path is read as `read_run` does.
    terms : sequence of str, or str with commas, optional
        By default the seven physical terms of the mount.
    encoder : {'enc', 'abs'}
        Pair of encoder columns.
    robust : bool
        Reduce the weight of outliers, or exclude them.

    Returns
    -------
    Fit

    Raises
    ------
    ValueError
        Too few usable rows, unknown terms, or columns that do not match their names.
    """
    if isinstance(terms, str):
        terms = names(terms)
    found = fit_run(_rows(run), terms, encoder=encoder, robust=robust)
    return Fit(Run(found.run), found.terms, fit_document(found))


@_one_thread
def diagnose(runs, base='physical', *, alpha=ALPHA, holdout=(), encoder='enc', seed=0,
             progress=None, first_answer=None, jobs=1):
    """Find the effects that a model lacks, and cross-validate the improvement.

    Parameters
    ----------
    runs : Run, PointingRun, str or Path, or a sequence of them
        Several are runs of one mount; a path is read by `read_run`.
    base : str
        Terms that the model has already: ``physical``, ``index``, ``standard6``, terms joined
        by +, ...
    alpha : float
        Family-wise error rate: chance that a run without errors gets any effect.
    holdout : as `runs`, optional
        Validation runs.
    encoder : {'enc', 'abs'}
    seed : int
        Seed of the resampling.
    progress, first_answer : callable, optional
        Called with the present step, and with the effects before cross-validation, as text; see
        `calibration.analysis.diagnosis.diagnosis.diagnose`.
    jobs : int
        Number of parallel processes, forked from this one. The result does not depend on it.
        See `calibration.analysis.diagnosis.diagnosis.diagnose`.

    Returns
    -------
    RunDiagnosis

    Raises
    ------
    ValueError
        Too few usable rows, unknown terms, columns that do not match their names, or validation
        rows that are all in the runs.
    """
    runs, notes = without_copies(_several(runs))
    if not runs:
        raise ValueError('no run is given')
    held, copies = without_copies(_several(holdout), runs)
    if notes or copies:
        runs[0] = runs[0].select(slice(None))
        runs[0].meta = {**runs[0].meta, 'notes': [*runs[0].meta.get('notes', ()), *notes, *copies]}
    checked = [check_columns(each, encoder) for each in (runs, held)]
    (runs, held), _ = settled_together(runs, held, encoder=encoder)
    return RunDiagnosis(_diagnose(runs, base, alpha, holdout=held or None, encoder=encoder,
                               seed=seed, progress=progress, jobs=jobs, checked=checked,
                               first_answer=first_answer and (
                                   lambda found: first_answer(wording(found)))))


def _rows(run):
    """PointingRun from any accepted argument."""
    rows = load_run(run) if isinstance(run, str | Path) else getattr(run, 'rows', run)
    if not isinstance(rows, PointingRun):
        raise ValueError(f'{type(run).__name__} is no run: give what read_run returns, or a path')
    return rows


def _several(runs):
    """List of PointingRun."""
    one = isinstance(runs, str | Path | Run | PointingRun)
    return [_rows(run) for run in ([runs] if one else runs)]
