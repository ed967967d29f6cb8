"""The result of a fit to a measured run, as JSON."""

from datetime import datetime, timezone

import numpy as np

from calibration.analysis.term_notes import (
    few_lines,
    notes_of_terms,
    raised_lines,
    undetermined_lines,
)
from msg_tools.units import ARCSEC
from pointing_model.rms import rms_arcsec

from .diagnosis.row_counts import RMS_KEYS, excluded_of_fit, far_text, fit_row_counts

_NAMED = 5  # rejected rows that a report names in words, at most


def fit_document(run, result, encoder='enc', held_out=None, checked=None):
    """What ``fit --json`` writes; keys that `Diagnosis.to_dict` has too mean the same.

    Parameters
    ----------
    run : PointingRun
    result : FitResult
    encoder : {'enc', 'abs'}
    held_out : Rms, optional
        Of each half of the rows, by a fit to the other.
    checked : diagnosis.input_check.ColumnCheck, optional

    Returns
    -------
    dict
        ``terms`` (``name``, ``value_arcsec``, ``sigma_arcsec``, ``within95_arcsec`` by Student's t
        with ``degrees_of_freedom``, null where the noise is given; of those with ``undetermined``
        null as well, and their value is what they have in the model); the ``degrees_of_freedom`` of
        the fit; ``before`` (as the encoders read) and ``after``; ``condition``, ``rank``,
        ``correlations`` (of all pairs of terms: ``terms``, ``value``), ``undetermined`` (what the
        stars do not determine, in words); rows, notes, and places for what else a fit may give:
        ``harmonics``, ``predicted``, ``base_model``, ``origin_of_errors``
        (`sky_model.Origin.document`).
    """
    told, used = fit_row_counts(run, result), run.select(result.weights > 0.0)
    matrix = result.correlations
    return {
        **run.mount.entries(), 'observations': told.used,
        'terms': result.term_rows(interval=True),
        'degrees_of_freedom': result.degrees_of_freedom,
        'before': _entry(rms_arcsec(*used.offsets(encoder))),
        'after': _entry(result.rms_arcsec(rejected=False), held_out),
        'condition': float(result.condition) if np.isfinite(result.condition) else None,
        'rank': int(result.rank),
        'correlations': [{'terms': [a, b], 'value': float(matrix[i, j])}
                         for i, a in enumerate(result.names)
                         for j, b in enumerate(result.names[:i]) if np.isfinite(matrix[i, j])],
        'undetermined': [one['text'] for one in result.dropped], **told.to_dict(),
        'columns_alike': checked.alike if checked else [], 'readings': [],
        'excluded': [{'row': int(one['row']), 'reason': one['reason']}
                     for one in excluded_of_fit(run, result)],
        'notes': [*run.meta.get('notes', ()),
                  *(checked.warnings(run.mount.names) if checked else ()),
                  *undetermined_lines(result), *raised_lines(result, run),
                  *notes_of_terms(result.term_rows())],
        'harmonics': None, 'predicted': None, 'base_model': None, 'origin_of_errors': None}


def refused_fit(error):
    """As `fit_document` where the columns are not what they are named; what fits in ``readings``.

    Parameters
    ----------
    error : MistakenColumns
    """
    nothing = _entry(None)
    return {
        'observations': error.rows_used, 'terms': None, 'before': nothing, 'after': dict(nothing),
        'degrees_of_freedom': None, 'condition': None, 'rank': None, 'correlations': None,
        'undetermined': None,
        'rows_read': error.rows_read, 'rows_used': error.rows_used, 'outliers': [],
        'rms_with_outliers_arcsec': None, 'rows_are': 'line', 'rows_taken_back': 0,
        'rows_not_drawn': 0, 'detection_factor': 1.0,
        'columns_alike': [], 'readings': error.readings,
        'excluded': None, 'notes': [], 'harmonics': None, 'predicted': None, 'base_model': None,
        'origin_of_errors': None}


def told_entries(rows, result):
    """What the report of a night has of a fit that rejected rows, or has few; else nothing.

    Parameters
    ----------
    rows : PointingRun
    result : FitResult

    Returns
    -------
    dict
        ``outliers``: ``star``, ``time``, ``x_arcsec``, ``y_arcsec`` of the rejected rows, the
        farthest first; ``degrees_of_freedom``.
    """
    far = np.hypot(result.residual_x, result.residual_y)
    away = result.rejected[np.argsort(-far[result.rejected], kind='stable')]
    found = {}
    if len(away):
        found['outliers'] = [{
            'star': int(rows['star'][i]),
            'time': float(rows['time'][i]) if 'time' in rows else None,
            'x_arcsec': float(result.residual_x[i]) / ARCSEC,
            'y_arcsec': float(result.residual_y[i]) / ARCSEC} for i in away]
    if result.few:
        found['degrees_of_freedom'] = result.degrees_of_freedom
    return found


def told_lines(rows, result):
    """The same in words, list of str."""
    named = []
    for one in told_entries(rows, result).get('outliers', ()):
        when = one['time'] and datetime.fromtimestamp(one['time'], timezone.utc)
        far = far_text(np.hypot(one['x_arcsec'], one['y_arcsec']))
        named.append(f'star {one["star"]}{f" at {when:%H:%M:%S} UTC" if when else ""} is rejected: '
                     f'{far} off')
    more = [f'{len(named) - _NAMED} rows more are rejected'] * (len(named) > _NAMED)
    return [*named[:_NAMED], *more, *few_lines(result)]


def predicted_document(found):
    """Entry ``predicted``: of a model chosen to predict.

    Parameters
    ----------
    found : diagnosis.prediction.PredictiveModel

    Returns
    -------
    dict
        ``coefficients``; ``rms_arcsec`` and its axes of all ``rows``, outliers too, on the rows
        fitted; ``before`` and ``after`` (the terms alone, the choice repeated) with the means over
        the ``ways`` to leave rows out.
    """
    def mean(each):
        return {f'cv_{key}': value and float(np.mean([_entry(one)[key] for one in each]))
                for key, value in _entry(each[0] if each else None).items()
                if not key.startswith('cv_') and key.startswith('rms_')}
    fitted = {key: value for key, value in _entry(found.fitted).items() if key.startswith('rms_')}
    return {'coefficients': found.coefficients(), 'rows': int(found.rows), **fitted,
            'ways': len(found.after), 'before': mean(found.before), 'after': mean(found.after)}


def _entry(rms, held_out=None):
    """Entry of RMS with the keys of a diagnosis."""
    out = dict.fromkeys(RMS_KEYS)
    for before, one in (('', rms), ('cv_', held_out)):
        if one is not None:
            out.update({f'{before}rms_arcsec': float(one.radial),
                        f'{before}rms_x_arcsec': float(one.x),
                        f'{before}rms_y_arcsec': float(one.y)})
    return out
