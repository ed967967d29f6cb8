"""What the services of the calibration answer, in sentences."""

from msg_tools.units import ARCSEC

from ..analysis.external_check import ways
from ..analysis.held_out import steps_of


def zero_sentence(run, zero):
    """Of a MeasuredZero that was set in power-on `run`."""
    first, second = zero.mount.names.axes
    return (f'zero of power-on {run} by {zero.by}: {first} {zero.az / ARCSEC:+.2f} +- '
            f'{zero.sigma_az / ARCSEC:.2f} arcsec, {second} {zero.el / ARCSEC:+.2f} +- '
            f'{zero.sigma_el / ARCSEC:.2f} arcsec, relative to {zero.reference}')


def fit_sentence(report):
    """Of a fit, by its report; why it is not published, where it is not."""
    if 'refused' in report:
        return report['refused']
    step = steps_of(report)[-1]
    return (f'{report["stars"]} stars fitted; ' + (
        f'{step["step"]}: {step["held_out"]["radial"]:.2f} arcsec radial on stars held out'
        if step else 'too few to hold some of them out')
        + (f'; {report["rejected"]} rejected' if report['rejected'] else ''))


def finding_sentence(document):
    """The verdict of a diagnosis, and the effects that are in the model."""
    applied = ', '.join(document['applied'])
    return f'{document["verdict"]}: {applied}' if applied else document['verdict']


def refusal_sentences(document):
    """Why effects of a diagnosis are not in the model; '' where all are."""
    return '; '.join(f'not published: {entry["why"]}' for entry in document['refused'])


def rows_sentence(taken, zeros):
    """What was taken up in the middle of a night: `taken` rows, and the zeros that they give."""
    return (f'{taken.kept} observations, zeros by {ways(zeros.values()) or "Polaris"} of power-ons '
            + (', '.join(map(str, sorted(zeros))) or 'none'))
