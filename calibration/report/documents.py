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

"""Results of a fit and of a diagnosis as JSON."""

import numpy as np

from pointing_model.rms import rms_arcsec

from ..analysis.diagnosis.row_counts import RMS_KEYS
from .bolt_wording import alignment_document
from .diagnosis_wording import limit_words
from .noise_wording import correlation_sentence
from .wording import wording


def fit_document(found):
    """The document of ``fit --json``; keys shared with `Diagnosis.to_dict` mean the same.

    Parameters
    ----------
    found : calibration.analysis.run_fit.RunFit

    Returns
    -------
    dict
        ``terms`` (``name``, ``value_arcsec``, ``sigma_arcsec``, ``within95_arcsec`` by Student's t
        with ``degrees_of_freedom``, null if the noise is given; also null for ``undetermined``
        terms, whose value is that in the model); the ``degrees_of_freedom`` of the fit; ``before``
        (raw) and ``after``; ``condition``, ``rank``, ``correlations`` (of all pairs of terms:
        ``terms``, ``value``), ``undetermined`` (what the stars do not determine, in words); rows,
        notes, and optional results, or None: ``harmonics``, ``predicted``, ``base_model``,
        ``origin_of_errors`` (`sky_model.Origin.document`), ``polar_axis``
        (`bolt_wording.alignment_document`, equatorial mounts only).
    """
    run, result, base = found.run, found.terms, found.base
    used, matrix = run.select(result.weights > 0.0), result.correlations
    return {
        **run.mount.entries(), 'observations': found.counts['rows_used'],
        'terms': result.term_rows(interval=True),
        'degrees_of_freedom': result.degrees_of_freedom,
        'before': _entry(rms_arcsec(*used.offsets(found.encoder))),
        'after': _entry(result.rms_arcsec(rejected=False), found.halves),
        'condition': float(result.condition) if np.isfinite(result.condition) else None,
        'rank': int(result.rank),
        'correlations': [{'terms': [a, b], 'value': float(matrix[i, j])}
                         for i, a in enumerate(result.names)
                         for j, b in enumerate(result.names[:i]) if np.isfinite(matrix[i, j])],
        'undetermined': [one['text'] for one in result.dropped], **found.counts,
        'columns_alike': found.columns.alike, 'readings': [],
        'excluded': [{'row': int(one['row']), 'reason': one['reason']}
                     for one in found.excluded],
        'notes': list(map(wording, found.findings)),
        'harmonics': found.harmonics and {
            **found.harmonics, 'notes': list(map(wording, found.harmonic_findings))},
        'predicted': found.predicted and predicted_document(found.predicted),
        'base_model': base and base.compared(found.plain),
        'origin_of_errors': found.origin and found.origin.document(),
        'polar_axis': alignment_document(
            found.plain, equinox=run.meta.get('equinox_taken'))}


def refused_fit(error):
    """`fit_document` of a run with mistaken columns; ``readings`` has the readings that fit.

    Parameters
    ----------
    error : MistakenColumns
    """
    return {**refused_columns(error), 'notes': [], **dict.fromkeys((
        'terms', 'degrees_of_freedom', 'condition', 'rank', 'correlations', 'undetermined',
        'harmonics', 'predicted', 'base_model', 'origin_of_errors', 'polar_axis'))}


def refused_columns(error):
    """Entries common to all documents of a run with `MistakenColumns`."""
    return {
        'observations': error.rows_used, 'before': _entry(None), 'after': _entry(None),
        'rows_read': error.rows_read, 'rows_used': error.rows_used, 'outliers': [],
        'rms_with_outliers_arcsec': None, 'rows_are': 'line', 'rows_taken_back': 0,
        'rows_not_drawn': 0, 'detection_factor': 1.0, 'columns_alike': [],
        'readings': error.readings, 'excluded': None}


def predicted_document(found):
    """Entry ``predicted``: a predictive model.

    Parameters
    ----------
    found : diagnosis.prediction.PredictiveModel

    Returns
    -------
    dict
        ``coefficients``, ``parts`` (contribution of each effect); fit ``rms_arcsec`` and its axes
        over all ``rows`` with outliers; ``blocks_before`` and ``blocks``: cross-validated on blocks
        of time, for the terms alone and for the model; ``before`` and ``after``: the same on random
        folds, means over the ``ways`` (number of partitions); ``beyond`` (whether more than the
        terms is used), ``shares`` (weights of the averaged models), ``gain`` (ln of the ratio of
        RMS) and ``gain_sigma``; ``reach`` (standard errors of predictions); ``notes``.
    """
    def mean(each):
        return {f'cv_{key}': value and float(np.mean([_entry(one)[key] for one in each]))
                for key, value in _entry(each[0] if each else None).items()
                if not key.startswith('cv_') and key.startswith('rms_')}
    fitted = {key: value for key, value in _entry(found.fitted).items() if key.startswith('rms_')}
    return {'coefficients': found.coefficients(), 'rows': int(found.rows), **fitted,
            'blocks_before': mean([found.blocks_before] if found.blocks_before else []),
            'blocks': mean([found.blocks] if found.blocks else []),
            'ways': len(found.after), 'before': mean(found.before), 'after': mean(found.after),
            'beyond': found.found.beyond, 'shares': found.found.shares, 'gain': found.found.gain,
            'gain_sigma': found.found.gain_sigma, 'parts': found.parts, 'reach': found.reach,
            'notes': list(map(wording, found.findings()))}


def _entry(rms, held_out=None):
    """RMS entry with the keys of a diagnosis."""
    out = dict.fromkeys(RMS_KEYS)
    for before, one in (('', rms), ('cv_', held_out)):
        if one is not None:
            out.update({f'{before}rms_arcsec': float(one.radial),
                        f'{before}rms_x_arcsec': float(one.x),
                        f'{before}rms_y_arcsec': float(one.y)})
    return out


def run_diagnosis_document(found):
    """The document of ``diagnose --json``: `diagnosis_document` with ``notes`` in words."""
    return {**diagnosis_document(found), 'notes': list(map(wording, found.notes))}


def diagnosis_document(found):
    """`Diagnosis.to_dict`, with texts for users added.

    Parameters
    ----------
    found : calibration.analysis.diagnosis.diagnosis_result.Diagnosis
    """
    out, kind = found.to_dict(), found.observations.run.mount.names
    if out['wander']:
        out['wander'] = {**out['wander'], 'text': correlation_sentence(out['wander'], kind.axes)}
    if out['detectable']:
        words = limit_words(kind)
        out['detectable'] = [{**row, 'what': words[row['name']]} for row in out['detectable']]
    return out


def refused_document(error):
    """The JSON result of a run with mistaken columns.

    Parameters
    ----------
    error : MistakenColumns

    Returns
    -------
    dict
        The keys of `Diagnosis.to_dict`, and ``notes``; None where a key does not apply.
    """
    return {
        **refused_columns(error), 'verdict': 'refused', 'south': False, 'cv_contiguous': {},
        **{key: [] for key in ('effects', 'next_observations', 'as_read_terms', 'held_out',
                               'no_star', 'unphysical', 'notes')},
        **dict.fromkeys(('runs', 'base_terms', 'noise_floor_arcsec', 'detectable', 'wander',
                         'expected', 'as_read_rms_arcsec', 'equinox', 'unequal_scatter',
                         'unequal_axes', 'worst_rows', 'approach_from'))}
