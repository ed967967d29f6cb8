"""The page of a fit to a measured run."""

from pathlib import Path

import numpy as np

from calibration.report.row_wording import outlier_sentence
from msg_tools.output import write_text
from msg_tools.units import ARCSEC
from pointing_model.effects.base import readable

from .drawing import clean
from .page_parts import cards, folded, gains, listed, number, section, table, verdict, whole
from .provenance import provenance_section, site_text
from .residual_axes import of_mount, on_horizon
from .residual_figures import Residuals, controls, residual_sections
from .term_table import terms_section
from .wording import wording


def write_fit_page(path, found, document):
    """Write the page.

    Parameters
    ----------
    path : str or Path
    found : calibration.analysis.run_fit.RunFit
    document : dict
        Of `fit_document.fit_document`.

    Raises
    ------
    OSError
        It cannot be written.
    """
    write_text(path, render_fit(found, document))


def render_fit(found, document):
    """The page as text; parameters as of `write_fit_page`."""
    run, result, encoder = found.run, found.terms, found.encoder
    data = _residuals(found)
    source = run.meta.get('source') or ''
    before, after = document['before'], document['after']
    label, last = ('halves that the fit did not see', after['cv_rms_arcsec']) \
        if after.get('cv_rms_arcsec') is not None else ('rows fitted', after['rms_arcsec'])
    names = run.mount.names.axes
    headline = 'Nothing was fitted' if last is None else (
        f'From {before["rms_arcsec"]:.2f}″ as the encoders read to {last:.2f}″, {label}')
    outliers = outlier_sentence(document) if document['outliers'] else ''
    bars = [('as the encoders read', [(before['rms_arcsec'], 'before', '')]),
            (f'{len(result.names)} terms, rows fitted', [(after['rms_arcsec'], 'after', '')]),
            ('each half by a fit to the other', [(after.get('cv_rms_arcsec'), 'after', '')])]
    noise = float(np.hypot(*result.scatter)) / ARCSEC
    terms = document['terms'] or ()
    more = '' if not terms or 'within95_arcsec' not in terms[0] else (
        f'<p class="note">{document["degrees_of_freedom"]} degrees of freedom.</p>')
    site = run.meta.get('site')
    body = [
        '<h1>Fit of a pointing model</h1>',
        f'<p class="meta">{document["rows_used"]} of {document["rows_read"]} rows used · '
        f'{clean(Path(str(source)).name)} · terms {clean(", ".join(result.names))} · mount '
        f'{clean(run.mount.kind)}</p>',
        controls(data),
        verdict('', headline, [outliers, *map(wording, result.findings(run))],
                cards([(before['rms_arcsec'], 'as the encoders read'),
                       (after['rms_arcsec'], 'after, rows fitted'),
                       (after.get('cv_rms_arcsec'), 'after, halves not seen'),
                       (noise, 'noise of the fit')]), '', gains(bars, noise, 'noise of the fit')),
        *residual_sections(data),
        terms_section(document['terms'], result.correlations, list(result.names),
                      f'Encoder − catalogue, σ from the {result.covariance_from}; condition '
                      f'{result.condition:.0f}, rank {result.rank} of {len(result.names)}.', more),
        _compared(document, names), _left_out(document['excluded']),
        section('Notes', listed(document['notes'])),
        provenance_section([
            ('site', site_text(_site(site))), ('mount', run.mount.kind),
            ('encoder', {'enc': 'incremental', 'abs': 'absolute'}.get(encoder, encoder))],
            [source] if source else ()),
        '<footer>All offsets are encoder − catalogue, on the sky, in seconds of arc (arcsec, ″). '
        'RMS values are radial unless an axis is named.</footer>']
    return whole(f'Fit: {headline}', body, 'Fit of a pointing model')


def _site(site):
    if site is None or isinstance(site, dict):
        given = site or {}
    else:
        given = {name: getattr(site, name, None) for name in ('latitude', 'longitude', 'height')}
    out = {f'{name}_deg': float(np.degrees(given[name])) for name in ('latitude', 'longitude')
           if given.get(name) is not None}
    return out | ({'height_m': given['height']} if given.get('height') is not None else {})


def _residuals(found):
    run, result = found.run, found.terms
    before = np.array(run.offsets(found.encoder)) / ARCSEC
    after = np.array([result.residual_x, result.residual_y] if found.plain is result.model
                     else found.plain.residuals(run, found.encoder)) / ARCSEC
    words = np.where(result.weights > 0.0, 'used', '').astype(object)
    far = np.hypot(*after)
    for i in np.flatnonzero(~(result.weights > 0.0)):
        words[i] = f'rejected: an outlier, {far[i]:.1f}″ off' if np.isfinite(far[i]) else 'excluded'
    for one in result.excluded:
        words[one['row']] = f'excluded: {one["reason"]}'
    az, el, turned = on_horizon(run)
    runs = run.columns.get('run')
    stars = run.columns.get('star')
    return Residuals(
        [f'line {line}' if run.meta.get('lines') is not None else f'row {line}'
         for line in run.lines] if stars is None else
        [f'{star:g}' if isinstance(star, (float, np.floating)) else str(star) for star in stars],
        az, el, before, after, result.weights > 0.0, words, **of_mount(run.mount),
        time=run.columns.get('time'), groups=runs, group_word='run',
        noise=tuple(float(v) / ARCSEC for v in result.scatter),
        before_text='as the encoders read', after_text='model', turned=turned,
        places=None if run.mount.vertical else (run['az'], run['el']),
        utc=run.meta.get('time_is_utc', True))


def _compared(document, names):
    """Other models that were asked for, on rows that they did not see."""
    rows = [('as the encoders read', 'rows fitted', *_rms(document['before'])),
            ('the terms', 'rows fitted', *_rms(document['after']))]
    if document['after'].get('cv_rms_arcsec') is not None:
        rows.append(('the terms', 'halves not seen', *_rms(document['after'], 'cv_')))
    predicted, more = document.get('predicted'), ''
    if predicted:
        rows += [('chosen to predict', 'all rows', *_rms(predicted)),
                 ('the terms', 'rows left out', *_rms(predicted['before'], 'cv_')),
                 ('chosen to predict', 'rows left out', *_rms(predicted['after'], 'cv_'))]
        more = folded('What was chosen to predict', table(
            ('coefficient', 'value ″', 'σ ″'), [
                (readable(row['name']), number(row['value_arcsec'], 2, True),
                 number(row['sigma_arcsec'], 2)) for row in predicted['coefficients']], 'numbers'))
    harmonics = document.get('harmonics')
    if harmonics:
        fitted = harmonics['fitted']
        rows.append((harmonics['label'], 'rows fitted', *(number(fitted.get(key))
                                                          for key in ('x', 'y', 'radial'))))
    return section('Models that were compared', table(
        ('model', 'on', f'{names[0]} ″', f'{names[1]} ″', 'radial ″'), rows, 'numbers'), more,
        note='RMS on the sky, arcsec.')


def _rms(entry, before=''):
    return [number(entry.get(f'{before}rms_{part}arcsec')) for part in ('x_', 'y_', '')]


def _left_out(excluded):
    """Rows that never came to the fit, and why."""
    if not excluded:
        return ''
    reasons = {}
    for one in excluded:
        reasons.setdefault(str(one['reason']), []).append(str(one['row']))
    return section('What was left out, and why', table(
        ('reason', 'count', 'rows'), [
            (reason, len(rows), ', '.join(rows[:40]) + (' …' if len(rows) > 40 else ''))
            for reason, rows in sorted(reasons.items(), key=lambda item: -len(item[1]))]))
