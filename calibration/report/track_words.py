"""What tracking says at the end of a night, for people."""

from datetime import datetime, timezone


def tracking_lines(document):
    """Lines of the document of `night.TrackedNight`.

    Parameters
    ----------
    document : dict

    Returns
    -------
    list of str
    """
    expected, rates = document['expected_arcsec'], document['rates_arcsec_per_root_hour']
    found = document['innovations']
    out = [f'{document["stars"]} stars; expected error {expected["now"]:.2f} arcsec after the last '
           f'one, {expected["10 min"]:.2f} ten minutes and {expected["1 h"]:.2f} an hour later',
           f'zeros wander by {rates["zero"]:.1f} arcsec in an hour (and as the root of time), the '
           f'lean of the first axis by {rates["tilt"]:.1f}']
    if found['stars']:
        out.append(f'{found["stars"]} stars: errors were {found["mean_square"]**0.5:.2f} times the '
                   f'predicted ones (RMS; 1 is right), {found["beyond_95"]} beyond 95 %; the '
                   f'filter at the end: {document["confidence_sentence"]}')
    begun = document.get('opening')
    if begun:
        out.append(f'since the nights before, by the first {begun["stars"]} stars: ' + ', '.join(
            f'{story} {100.0 * chance:.0f} %' for story, chance in begun['chances'].items()))
    for event in document['events']:
        when = datetime.fromtimestamp(event['stamp'] * 1e-9, timezone.utc)
        out.append(f'{when:%H:%M:%S} {event["text"]}')
    return out
