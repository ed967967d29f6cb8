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

"""A diagnosis prepared for its page: names, units, drivers, sentences."""

from dataclasses import dataclass, field
from pathlib import PurePath

import numpy as np

from calibration.analysis.finding import is_caution
from msg_tools.units import ARCSEC
from pointing_model.effects.base import coefficient_word, readable
from pointing_model.mounts import is_beyond
from pointing_model.runs.columns.run_table import AS_NAMED

from . import figure_wording, row_wording
from .cause_wording import open_causes, plain_name, short_cause, still_open
from .diagnosis_summary import DiagnosisSummary, summary_of
from .documents import diagnosis_document
from .driver_labels import Driver, driver_of
from .effect_wording import effect_summary, effect_title
from .number_wording import value_and_error
from .provenance import about, axes_note
from .residuals import Residuals, turned
from .sky_map import grid_of
from .verdict_wording import (
    VERDICTS,
    Statement,
    verdict_sentences,
)
from .wording import paragraph, wording

_ALWAYS = ('azimuth', 'elevation', 'time', 'order', 'temperature', 'approach_az', 'approach_el',
           'magnitude', 'az_rate')


@dataclass
class FoundEffect:
    """An effect found, for its part of the page.

    Attributes
    ----------
    title, name : str
        Its name in running text and as a heading.
    summary : Statement
    text : str
        Full text of the summary.
    facts : list of (str, str)
    fitted, own : ndarray, shape (2, n)
        Fitted offset of each row, and its part that no term and no other effect absorbs, see
        `page_figures.its_own`; arcsec on the sky.
    driver : Driver, optional
    causes : list of tuple
        Cause, ΔBIC, coefficients, what to check.
    fades : bool
        Whether it decreases with elevation on the sky.
    """

    title: str
    summary: Statement
    facts: list
    fitted: np.ndarray
    own: np.ndarray
    driver: Driver | None = None
    causes: list = field(default_factory=list)
    fades: bool = False

    def __post_init__(self):
        self.name, self.text = self.title[:1].upper() + self.title[1:], self.summary.text


@dataclass
class DiagnosisView:
    """Everything that terminal and page show, with texts in words.

    Attributes
    ----------
    document : dict
        The JSON result.
    residuals : Residuals
        The rows, for the figures common to all pages.
    drivers : list of Driver
    effects : list of FoundEffect
    ranking : list of dict
        Candidates, tested on the residuals of the declared model: ``name, driver, axes,
        delta_bic, p_family, in_set``.
    terms : list of dict
        ``name, value, sigma, unit``.
    correlated : list of str
    correlations : ndarray, shape (k, k), optional
        Of the coefficients in `correlated`.
    summary : DiagnosisSummary
    sentences : list of str
        The verdict for the terminal, headline first.
    badge : tuple of str
        Class and word of the verdict, depending on whether causes are open.
    word : str
        Name of the verdict.
    meta, used, floor : str
        Short description of the data; rows used; label of the noise floor.
    notes, page_notes, signs, left_out : list of str
        Notes for the terminal and for the page, on the signs of columns, and on excluded rows.
    untestable : list of (str, str)
        Effects that this run cannot test, and why.
    run_terms : dict
        Run -> {term: arcsec} fitted to that run alone.
    about : str
        Telescope, date and site.
    axes_note : str
        Meaning of the angles beyond the pole.
    fits : list of (str, Linearisation, list of str)
        See `refit_preview.preview`; empty if rows cannot be excluded on the page.
    lines, file
        Numbers of the rows, and their file.
    changed : bool
        Whether the effects changed any residual.
    """

    document: dict
    residuals: Residuals
    drivers: list
    effects: list
    ranking: list
    terms: list
    summary: DiagnosisSummary
    sentences: list = ()
    badge: tuple = ('', '')
    word: str = ''
    meta: str = ''
    used: str = ''
    floor: str = ''
    notes: list = ()
    page_notes: list = ()
    signs: list = ()
    left_out: list = ()
    untestable: list = ()
    run_terms: dict = field(default_factory=dict)
    correlated: list = ()
    correlations: np.ndarray | None = None
    about: str = ''
    axes_note: str = ''
    fits: list = ()
    lines: list = ()
    file: str = ''

    def __post_init__(self):
        self.changed = bool(np.any(np.abs(self.residuals.before - self.residuals.after) > 1e-9))


def view_of(diagnosis, document=None):
    """Prepare a diagnosis for terminal and page.

    Parameters
    ----------
    diagnosis : calibration.analysis.diagnosis.diagnosis_result.Diagnosis
    document : dict, optional
        Result of `documents.diagnosis_document`; by default made here.

    Returns
    -------
    DiagnosisView
    """
    obs, document = diagnosis.observations, document or diagnosis_document(diagnosis)
    context = obs.context
    effects = [_found(diagnosis, e) for e in diagnosis.effects]
    summaries, caution = [e.summary for e in effects], paragraph(diagnosis.cautions)
    headline, sentences = verdict_sentences(document, summaries, limit=20, caution=caution)
    notes = list(dict.fromkeys(map(wording, diagnosis.notes)))
    names, matrix = diagnosis.correlations
    return DiagnosisView(
        {**document, 'excluded': diagnosis.excluded}, _residuals(diagnosis, document),
        _drivers(diagnosis, effects), effects, _ranking(diagnosis, context.mount),
        _terms(diagnosis),
        summary_of(document, [e.title for e in effects], [one.reach_arcsec for one in summaries],
                   [*filter(None, [caution]),
                    *dict.fromkeys(map(wording, filter(is_caution, diagnosis.notes)))]),
        sentences=[headline, *sentences], badge=_badge(document),
        word=VERDICTS.get(document['verdict'], document['verdict']),
        meta=_meta(document, _sources(obs)), used=row_wording.used_sentence(document),
        floor=figure_wording.floor_words(document), notes=notes, page_notes=_page_notes(diagnosis),
        signs=row_wording.signs_sentences(diagnosis.columns_alike, context.mount.names,
                                          obs.run.meta.get('taken', AS_NAMED)),
        left_out=row_wording.left_out_lines(diagnosis.excluded, len(obs.runs) > 1,
                                            document['rows_are']),
        untestable=diagnosis.untestable, run_terms=diagnosis.run_terms,
        correlated=_coefficients(names, diagnosis), correlations=matrix,
        about=about(obs, _sources(obs)), axes_note=axes_note(context),
        fits=_refits(diagnosis), lines=obs.lines,
        file=(_sources(obs) or [''])[0])


def _badge(document):
    badge = document['verdict']
    if document['effects'] and badge in ('ambiguous', 'identified'):
        badge = 'ambiguous' if any(
            open_causes(row) > 1 for row in document['effects']) else 'identified'
    return badge if badge in VERDICTS else '', VERDICTS.get(badge, badge)


def _meta(document, sources):
    """Short description of the data of a diagnosis: rows, runs, files, terms."""
    runs = document['runs']
    text = row_wording.used_sentence(document).partition(';')[0] + f' in {runs} runs' * (runs > 1)
    sources = sources[:3] + ([f'and {len(sources) - 3} more'] if len(sources) > 3 else [])
    base = document['base_terms']
    return ' · '.join([text, *([', '.join(sources)] if sources else []),
                       f'{len(base)} terms' if base else 'no model'])


def _residuals(diagnosis, document):
    obs, context = diagnosis.observations, diagnosis.observations.context
    before, after = diagnosis.residual_before / ARCSEC, diagnosis.residual_after / ARCSEC
    used, floor = diagnosis.weights > 0.0, document.get('noise_floor_arcsec')
    return Residuals(
        _row_names(obs, document['rows_are']), *context.on_horizon(), before, after, used,
        np.where(used, '', 'outlier'), **_axes_of(context),
        time=context.get('time'), utc=getattr(context, 'time_is_utc', True), groups=_groups(obs),
        noise=None if floor is None else (floor / np.sqrt(2.0),) * 2,
        before_text='fit residuals, terms alone',
        after_text='fit residuals, with the effects'
        if np.any(np.abs(before - after) > 1e-9) else 'after',
        noise_text='all that the model leaves'
        if (document.get('wander') or {}).get('slow') else 'noise of the fit')


def _groups(obs):
    """Name of the run of each row; None for a single run or more than 100 runs."""
    if not 1 < len(obs.runs) <= 100:
        return None
    names = [name if isinstance(name, (int, float)) else PurePath(str(name)).name
             for name in obs.runs]
    return np.array(names if len({type(name) for name in names}) == 1 else list(map(str, names))
                    )[obs.label]


def _ranking(diagnosis, mount):
    """Candidates, with a mark if noise explains as much, and the axis names of the mount."""
    like = (diagnosis.noise_memory or {}).get('like', ())
    rows = [{**row, 'or_noise': row['name'] in like} for row in diagnosis.ranking]
    if mount.vertical:
        return rows
    words = dict(zip(('az', 'el'), mount.names.axes))

    def driver(name):
        kind, _, axis = (name or '').rpartition('_')
        return f'{kind} {words[axis]}' if kind and axis in words else name
    return [{**row, 'axes': words.get(row['axes'], row['axes']),
             'name': plain_name(row['name'], mount.kind),
             'driver': driver(row.get('driver'))} for row in rows]


def _axes_of(context):
    """Names of the axes, and their orientation relative to the horizon."""
    mount = context.mount
    if mount.vertical and not is_beyond(context.el).any():
        return {}
    first, second = mount.names.axes
    return {'grid': grid_of(mount), 'axes': (f'{first} × cos {mount.names.letters[1]}', second),
            'turned': turned(context.tangent(), *context.on_horizon())}


def _row_names(obs, word):
    """Names of the rows, for tooltips."""
    names = [f'{word} {line}' for line in obs.lines]
    if len(_sources(obs)) > 1:
        names = [f'{PurePath(str(source)).name} {name}'
                 for source, name in zip(obs.sources, names)]
    stars = obs.run.columns.get('star')
    return names if stars is None else [
        f'{name}, star {star:g}' if isinstance(star, float) else f'{name}, star {star}'
        for name, star in zip(names, stars.tolist())]


def _sources(obs):
    several = [str(name).rsplit(':', 1)[0] for name in obs.runs if isinstance(name, str)
               and ':' in name]
    sources = several or [obs.run.meta.get('source') or '']
    return [PurePath(s).name for s in dict.fromkeys(sources) if s]


#: kinds of findings shown in tables of the page
_IN_TABLES = ('another model', 'curve')


def _page_notes(diagnosis):
    """Notes of the page that are not in its tables."""
    return [*dict.fromkeys(wording(one) for one in diagnosis.notes
                           if getattr(one, 'kind', '') not in _IN_TABLES),
            *(e.fitted.effect.alias for e in diagnosis.effects if e.fitted.effect.alias)]


# --------------------------------------------------------------------------------------- drivers

def _drivers(diagnosis, effects):
    """Drivers for the figures: those of the effects first, then all known ones."""
    context = diagnosis.observations.context
    names = [e.driver.name for e in effects if e.driver is not None and e.driver.plain]
    names += context.mount.names.keys
    names += [n for n in _ALWAYS if not (n == 'order' and context.get('time') is not None)]
    names += context.extra()
    out = (driver_of(context, name) for name in dict.fromkeys(names))
    return [driver for driver in out if driver is not None]


# --------------------------------------------------------------------------------------- effects

def _found(diagnosis, found):
    context = diagnosis.observations.context
    e = found.fitted.effect
    return FoundEffect(
        effect_title(found, context.mount.names.axes), effect_summary(diagnosis, found),
        _facts(found, context), found.offsets, found.own, _effect_driver(context, e),
        _causes(found, context), 'cos' in e.formula and e.driver.startswith('appr'))


def _causes(found, context):
    """Rows of the table of its likely causes."""
    e = found.fitted.effect
    rows = [(short_cause(one['cause']) + ' (fitted)' * _is_fitted(one, found, context),
             f'{one["delta_bic"]:.1f}', _size_of(one, context),
             _first_part(one.get('look_at') or ''))
            for one in found.causes] if len(found.causes) > 1 else [
        (short_cause(e.cause), _gain(found.delta_bic), _coefficients_of(found, context),
         _first_part(e.look_at))]
    return rows + [(short_cause(one['cause']), f'alone {one["alone"]:.1f}', '',
                    _first_part(one.get('look_at') or '')) for one in still_open(vars(found))]


def _is_fitted(cause, found, context):
    """Whether this cause is the one in the model: its coefficients are those fitted."""
    return _size_of(cause, context).startswith(_coefficients_of(found, context))


def _gain(value):
    """A gain as text, or a dash."""
    return '–' if value is None else f'{value:.1f}'


def _first_part(text):
    return text.partition('; ')[0]


def _size_of(cause, context):
    """Coefficients fitted with a cause, and TF with it; '' if it was not fitted."""
    fitted = cause.get('fitted')
    if fitted is None:
        return ''
    sizes = [f'{context.wording(one["word"])} {_with_error(one)}'
             for one in fitted['coefficients']]
    if 'TF' in fitted['terms']:
        sizes.append(f'TF {_with_error(fitted["terms"]["TF"])}')
    return ', '.join(sizes)


def _coefficients_of(found, context):
    """Coefficients of an effect with errors, and units other than arcsec."""
    e = found.fitted.effect
    values = zip(e.coefficient_names, found.fitted.coefficients / ARCSEC,
                 found.fitted.sigma / ARCSEC)
    unit = '' if e.unit == 'arcsec' else f' {e.unit}'
    return ', '.join(f'{context.wording(coefficient_word(e, name))} '
                     f'{" ± ".join(value_and_error(value, sigma))}{unit}'
                     for name, value, sigma in values)


def _with_error(one):
    return ' ± '.join(value_and_error(one['value_arcsec'], one['sigma_arcsec']))


def _facts(found, context):
    e = found.fitted.effect
    facts = [('formula', e.formula)]
    if len(found.causes) > 1 and not any(_is_fitted(one, found, context) for one in found.causes):
        facts.append(('fitted', _coefficients_of(found, context)))
    if e.tpoint:
        facts.append(('TPOINT', e.tpoint))
    if found.aliases:
        facts.append(('same curve here', '; '.join(
            plain_name(name, context.mount.kind) for name in found.aliases)))
    return facts


def _effect_driver(context, e):
    """Driver on the x axis of the figure of an effect."""
    if e.figure is None:
        return driver_of(context, e.driver)
    label, values = e.figure(context)
    return None if values is None else Driver(e.driver, label, values, plain=False)


# ----------------------------------------------------------------------------------------- terms

def _terms(diagnosis):
    model = diagnosis.model
    own, label = set(diagnosis.base.own), diagnosis.observations.context.wording
    out = [{'name': name + (' (median of the runs)' if name in own else ''),
            'value': value / ARCSEC, 'sigma': None if name in own else float(s) / ARCSEC,
            'unit': 'arcsec', 'undetermined': name in model.undetermined,
            'alone': diagnosis.base_model.terms[name] / ARCSEC
            if diagnosis.effects and name in diagnosis.base_model.terms else None}
           for (name, value), s in zip(model.terms.items(), model.sigmas)]
    for found in diagnosis.effects:
        e, f = found.fitted.effect, found.fitted
        out += [{'name': f'{readable(e.name)}: {label(coefficient_word(e, name))}',
                 'value': value / ARCSEC,
                 'sigma': float(s) / ARCSEC, 'unit': e.unit}
                for name, value, s in zip(e.coefficient_names, f.coefficients, f.sigma)]
    return out


def _refits(diagnosis):
    """Both fits of a run of one file, with the names used in the table of terms."""
    obs = diagnosis.observations
    if len(_sources(obs)) > 1 or not diagnosis.linear:
        return ()
    effects, label = {e.fitted.effect.name: e.fitted.effect for e in diagnosis.effects}, \
        obs.context.wording
    return [(when, fit, [
        f'{readable(name)}: {label(coefficient_word(effects[name], c))}'
        if name in effects else name for name, c in fit.names])
        for when, fit in zip(('before', 'after'), diagnosis.linear)]


def _coefficients(names, diagnosis):
    """Names of coefficients; an effect with one coefficient has its name only."""
    several = {name for name, _ in names if sum(name == n for n, _ in names) > 1}
    effects = {e.fitted.effect.name: e.fitted.effect for e in diagnosis.effects}
    return [readable(name) + (f': {coefficient_word(effects[name], c)}' if name in several else '')
            if c else name for name, c in names]
