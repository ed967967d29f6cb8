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

"""The pipeline of a fit to a measured run, from its columns to model and findings.

The command ``fit`` and `telescope_mount.fit` add options and printing.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from msg_tools.units import ARCSEC
from pointing_model.model import PointingModel
from pointing_model.rms import Rms
from pointing_model.runs.run import PointingRun
from pointing_model.zero import NO_ZERO, Zeros

from .diagnosis.base_terms import Base
from .diagnosis.implausible_terms import suspicious
from .diagnosis.mistaken_columns import ColumnCheck, check_columns
from .diagnosis.residual_patterns import (
    STEP,
    ResidualRows,
    cluster_findings,
    jump_findings,
    memory_findings,
    rounding_findings,
    visit_findings,
)
from .diagnosis.row_counts import excluded_of_fit, fit_row_counts
from .diagnosis.sessions import arrange, split_at_steps, with_zeros
from .external_check import checked_by_halves
from .finding import Finding, cautions_first
from .fit_result import FitResult
from .harmonic_fit import Recipe, fit_chosen
from .sky_model import Origin, settled
from .term_fit import fit_terms


@dataclass
class RunFit:
    """Result of a fit to a measured run.

    Attributes
    ----------
    run : PointingRun
        With its settled kind of errors (`sky_model.settled`), and held effects of a base model
        subtracted.
    encoder : {'enc', 'abs'}
    terms : FitResult
    model : PointingModel
        With harmonics or predictive effects, and held effects of a base model.
    plain : PointingModel
        The same without held effects of a base model.
    columns : ColumnCheck
    halves : Rms or None
        RMS of each half of the rows, by a fit to the other half.
    origin : Origin or None
        Kind of errors of a German mount (mount or sky).
    counts : dict
        From `RowCounts`.
    few_used : bool
        More than a third of the rows is excluded.
    excluded : list of dict
        ``row`` in the file and ``reason`` of the excluded rows.
    harmonics : dict or None
        See `harmonic_fit.fit_chosen`, with ``harmonic_findings``.
    predicted : diagnosis.prediction.PredictiveModel or None
    base : base_model.BaseModel or None
    findings : list of Finding or str
        Warnings and notes; those of the file's reader first, unchanged.
    """

    run: PointingRun
    encoder: str
    terms: FitResult
    model: PointingModel
    plain: PointingModel
    columns: ColumnCheck
    halves: Rms | None
    origin: Origin | None
    counts: dict
    few_used: bool
    excluded: list
    harmonics: dict | None = None
    harmonic_findings: list = ()
    predicted: object = None
    base: object = None
    findings: list = field(default_factory=list)


def fit_run(run, terms=None, *, encoder='enc', robust=True, base=None, harmonics=None,
            predict=False, source=None, sessions=0.0, **solver):
    """Check the columns of a run, and fit the requested model.

    Parameters
    ----------
    run : PointingRun
    terms : sequence of str, optional
        By default those of `base`, or the physical ones of the mount.
    encoder : {'enc', 'abs'}
    robust : bool
    base : base_model.BaseModel, optional
        Its terms are refitted, the rest is held; it also sets the kind of errors of the mount.
    harmonics : harmonic_fit.HarmonicChoice, optional
    predict : bool
        Add effects that depend on direction and improve the prediction of held-out stars.
    source : str, optional
        Source in the model's provenance; by default that of the run.
    sessions : float, optional
        A gap longer than this, in hours, begins a session with zeros of its own, see
        `diagnosis.sessions.arrange`; None: decided by the data; 0: one zero for all rows.
    **solver
        See `estimation.gauss_newton.gauss_newton`.

    Returns
    -------
    RunFit

    Raises
    ------
    MistakenColumns
        A ValueError: the columns do not hold what their names say.
    ValueError
        Too few usable rows or unknown terms.
    """
    if f'az_{encoder}' not in run:
        raise ValueError(f'{run.meta.get("source", "the run")} has no second encoder; leave out '
                         f'--encoder {encoder}')
    columns = check_columns(run, encoder)
    if terms is None:
        terms = base.terms if base else run.mount.names.physical
    terms = tuple(terms)
    if base:
        run = base.taken_off(base.matched(run), encoder)
    settled_run, origin = settled(run, terms, encoder=encoder, robust=robust)
    if not base:
        run = settled_run
    source = {'source': str(source or run.meta.get('source', ''))}
    read = run
    if sessions != 0.0:
        run = arrange(run, Base(terms), run.mount.names.index, sessions, encoder,
                      least_step=0.0).runs[0]
    own = sessions != 0.0 and 'run' in run and len(np.unique(run['run'])) > 1
    how = {'robust': robust, 'encoder': encoder, 'run_zeros': own, **solver}
    result = fit_terms(run, terms, provenance=source, **how)
    halves = checked_by_halves(run, result, terms, **how)
    counts = fit_row_counts(run, result)
    out = RunFit(run, encoder, result, result.model, result.model, columns, halves, origin,
                 counts.to_dict(), counts.too_few, excluded_of_fit(run, result), base=base)
    if harmonics:
        fitted, out.harmonics, out.harmonic_findings = fit_chosen(
            run, harmonics, Recipe(NO_ZERO, own, terms, encoder, robust), result)
        out.plain = replace(fitted.model, provenance={**fitted.model.provenance, **source})
        zeros = fitted.zeros
    newest = []
    if own and not harmonics:
        out.plain, zeros, newest = _newest_zeros(result, run.mount.names.index)
    if own:
        out.plain = with_zeros(out.plain, zeros.values(), read, run)
    if predict:
        from .diagnosis.prediction import predictive_model
        out.predicted = predictive_model(run, '+'.join(terms), encoder=encoder)
        out.plain = out.predicted.model
    out.model = base.whole(out.plain) if base else out.plain
    out.findings = cautions_first([
        *newest, *run.meta.get('notes', ()), *columns.doubts(run.mount.names),
        *result.findings(run),
        *implausible_values(result.term_rows()), *_patterns(run, result, terms, how)])
    return out


def _newest_zeros(result, index):
    """The model with the zeros of the newest run in place of those of the first.

    Returns
    -------
    model : PointingModel
    zeros : Zeros
        Zeros of the runs relative to it.
    newest : list of Finding
    """
    newest, names = result.zeros.newest, list(result.names)
    terms, take = dict(result.model.terms), np.eye(len(result.model.terms), len(names))
    for name, zero in zip(index, newest.angles):
        if name in terms:
            terms[name] += float(zero)
            take[names.index(name), names.index(f'{name}[{newest.run:g}]')] = 1.0
    beside = newest.angles * [name in terms for name in index]
    zeros = Zeros(zero.plus(*-beside) for zero in result.zeros.values())
    model = replace(result.model, terms=terms, covariance=take @ result.covariance @ take.T)
    return model, zeros, [Finding('zeros of the newest run', evidence={'run': newest.run, 'terms': {
        name: terms[name] / ARCSEC for name in index if name in terms}})]


def _patterns(run, result, terms, how):
    """Findings on revisited places (with new zeros after a step), correlated rows, outliers."""
    rows = ResidualRows.from_fit(run, result, how['encoder'])
    out = visit_findings(rows, rows.visits(terms, how['run_zeros']))
    if not how['run_zeros'] and out and out[0].kind == STEP:
        split = split_at_steps(run, terms, how['encoder'])
        after = fit_terms(split, terms, **{**how, 'run_zeros': True})
        out = [replace(out[0], before=result.rms_arcsec().radial,
                       after=after.rms_arcsec().radial)]
    elif not how['run_zeros']:
        out += jump_findings(rows, terms)
    return [*out, *memory_findings(rows, terms), *cluster_findings(rows),
            *rounding_findings(run.meta, float(np.hypot(*result.scatter)) / ARCSEC)]


def one_of_runs(run, number=None, zeros_known=False):
    """The rows of one run; or all rows, with a finding if several runs are fitted as one.

    Parameters
    ----------
    run : PointingRun
    number : int, optional
        Value in its column ``run``; None: all.
    zeros_known : bool
        The zeros of the runs are already subtracted, as in this project's logs.
    """
    numbers = sorted(set(run['run'].tolist())) if 'run' in run else []
    if number is not None:
        rows = run.get('run') == number
        if not rows.any():
            there = ', '.join(f'{n:g}' for n in numbers) or 'no column run'
            raise ValueError(f'{run.meta.get("source", "the file")}: no run {number} (there: '
                             f'{there})')
        return run.part(rows, lines=run.lines[rows])
    if len(numbers) > 1 and not zeros_known:
        run.meta['notes'] = [*run.meta.get('notes', ()),
                             Finding('runs fitted as one', len(numbers), unit='')]
    return run


def implausible_values(terms):
    """Findings on values that no mount should have, in rows of `FitResult.term_rows`."""
    return [Finding('implausible term', row['value_arcsec'], row['sigma_arcsec'], evidence=row,
                    caution=True)
            for row in suspicious(terms)]
