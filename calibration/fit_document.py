"""The result of a fit to a measured run, as JSON."""

import numpy as np

from pointing_model.rms import rms_arcsec

from .diagnosis.rows_told import RMS_KEYS, excluded_of_fit, rows_of_fit


def fit_document(run, result, encoder='enc', held_out=None, checked=None):
    """What ``fit --json`` writes; keys that `Diagnosis.to_dict` has too mean the same.

    Parameters
    ----------
    run : PointingRun
    result : FitResult
    encoder : {'enc', 'abs'}
    held_out : Rms, optional
        Of each half of the rows, by a fit to the other.
    checked : diagnosis.input_check.Checked, optional

    Returns
    -------
    dict
        ``terms`` (``name``, ``value_arcsec``, ``sigma_arcsec``); ``before`` (as the encoders read)
        and ``after``; ``condition``, ``rank``, ``correlations`` (of all pairs of terms: ``terms``,
        ``value``), ``undetermined`` (what the stars do not determine, in words); rows, notes, and
        places for what else a fit may give: ``harmonics``, ``predicted``, ``base_model``,
        ``origin_of_errors`` (`sky_model.Origin.document`).
    """
    told, used = rows_of_fit(run, result), run.select(result.weights > 0.0)
    matrix = result.correlations
    return {
        **run.mount.entries(), 'observations': told.used,
        'terms': result.term_rows(),
        'before': _entry(rms_arcsec(*used.offsets(encoder))),
        'after': _entry(result.rms_arcsec(rejected=False), held_out),
        'condition': float(result.condition) if np.isfinite(result.condition) else None,
        'rank': int(result.rank),
        'correlations': [{'terms': [a, b], 'value': float(matrix[i, j])}
                         for i, a in enumerate(result.names)
                         for j, b in enumerate(result.names[:i])],
        'undetermined': [one['text'] for one in result.dropped], **told.to_dict(),
        'columns_alike': checked.alike if checked else [], 'readings': [],
        'excluded': [{'row': int(one['row']), 'reason': one['reason']}
                     for one in excluded_of_fit(run, result)],
        'notes': [*run.meta.get('notes', ()), *(checked.notes if checked else ())],
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
        'condition': None, 'rank': None, 'correlations': None, 'undetermined': None,
        'rows_read': error.rows_read, 'rows_used': error.rows_used, 'outliers': [],
        'rms_with_outliers_arcsec': None, 'columns_alike': [], 'readings': error.readings,
        'excluded': None, 'notes': [], 'harmonics': None, 'predicted': None, 'base_model': None,
        'origin_of_errors': None}


def predicted_document(found):
    """Entry ``predicted``: of a model chosen to predict.

    Parameters
    ----------
    found : diagnosis.predicting.Predicting

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
