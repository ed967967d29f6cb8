"""The result of a diagnosis, as JSON."""

from calibration.analysis.diagnosis.row_counts import RMS_KEYS

from .diagnosis_wording import limit_words
from .noise_wording import correlation_sentence


def diagnosis_document(found):
    """What ``diagnose --json`` writes: `Diagnosis.to_dict`, with words where data has some.

    Parameters
    ----------
    found : calibration.analysis.diagnosis.Diagnosis
    """
    out, kind = found.to_dict(), found.observations.run.mount.names
    if out['wander']:
        out['wander'] = {**out['wander'], 'text': correlation_sentence(out['wander'], kind.axes)}
    if out['detectable']:
        words = limit_words(kind)
        out['detectable'] = [{**row, 'what': words[row['name']]} for row in out['detectable']]
    return out


def refused_document(error):
    """The JSON result where the columns are not what they are named.

    Parameters
    ----------
    error : MistakenColumns

    Returns
    -------
    dict
        The keys of `Diagnosis.to_dict`; what does not apply is None.
    """
    nothing = dict.fromkeys(RMS_KEYS)
    return {
        'observations': error.rows_used, 'runs': None, 'base_terms': None, 'verdict': 'refused',
        'before': nothing, 'after': dict(nothing), 'noise_floor_arcsec': None, 'effects': [],
        'excluded': None, 'next_observations': [], 'rows_read': error.rows_read,
        'rows_used': error.rows_used, 'outliers': [], 'rms_with_outliers_arcsec': None,
        'columns_alike': [], 'readings': error.readings, 'detectable': None, 'wander': None,
        'expected': None, 'as_read_rms_arcsec': None, 'as_read_terms': [], 'south': False,
        'equinox': None, 'unequal_scatter': None,
        'cv_contiguous': {}, 'worst_rows': None, 'held_out': [],
        'no_star': [], 'unphysical': [], 'approach_from': None, 'rows_are': 'line',
        'rows_taken_back': 0, 'rows_not_drawn': 0, 'detection_factor': 1.0}
