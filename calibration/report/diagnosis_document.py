"""The result of a diagnosis, as JSON."""

from .diagnosis_wording import limit_words
from .fit_document import refused_columns
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
    return {
        **refused_columns(error), 'verdict': 'refused', 'south': False, 'cv_contiguous': {},
        **{key: [] for key in ('effects', 'next_observations', 'as_read_terms', 'held_out',
                               'no_star', 'unphysical')},
        **dict.fromkeys(('runs', 'base_terms', 'noise_floor_arcsec', 'detectable', 'wander',
                         'expected', 'as_read_rms_arcsec', 'equinox', 'unequal_scatter',
                         'worst_rows', 'approach_from'))}
