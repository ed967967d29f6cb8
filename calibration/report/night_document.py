"""What a calibration's fit of a night publishes, for JSON."""

from msg_tools.units import ARCSEC

from ..analysis.fit_result import named
from ..analysis.harmonic_fit import rows_of_terms
from ..rows import counts
from .wording import wording
from .zero_wording import zero_document

FORMAT, VERSION = 'telescope_mount/calibration_report', 1
#: the first coefficients, with correlations in the report: of all they grow with the square
CORRELATED = 40


def fit_report(rows, fitted, zeros, changes, harmonic, notes):
    """The fit itself.

    Parameters
    ----------
    rows : PointingRun
        That were fitted.
    fitted : FitResult
    zeros : Zeros
        That were measured.
    changes : list of (int, int, MeasuredZero)
        From which power-on to which.
    harmonic : bool
        Whether harmonics are published with it.
    notes : list of str
        What people must know of it is added.

    Returns
    -------
    dict
    """
    if not harmonic:
        notes += map(wording, fitted.open_directions)
    notes += [f'row {row["row"]} left out: {row["reason"]}' for row in fitted.excluded]
    rejected = fitted.rejected_stars(rows)
    notes += map(wording, [*named(rejected), *fitted.freedom_findings])
    return {
        'format': FORMAT, 'version': VERSION, **rows.mount.entries(), **counts(rows),
        'zeros': list(map(zero_document, zeros.values())),
        'changes': [{'from': before, 'to': after, **zero_document(change)}
                    for before, after, change in changes],
        'zeros_in_force': fitted.zeros.to_list(),
        'terms': rows_of_terms(fitted.model) if harmonic else fitted.term_rows(),
        'correlations': fitted.correlations[:CORRELATED, :CORRELATED].tolist(),
        'condition': fitted.condition,
        'rejected': len(fitted.rejected),
        **({'outliers': [one.evidence for one in rejected]} if rejected else {}),
        **({'degrees_of_freedom': fitted.degrees_of_freedom} if fitted.few else {}),
        'noise_arcsec': [s / ARCSEC for s in fitted.scatter],
    }
