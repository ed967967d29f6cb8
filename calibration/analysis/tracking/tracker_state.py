"""The state of a tracker as a JSON text, from which it goes on to the bit."""

import json
from dataclasses import asdict

import numpy as np

from pointing_model.model_document import from_document
from pointing_model.model_document import to_json as model_to_json

from .filter_confidence import Confidence
from .motion_causes import TrackingSettings

FORMAT, VERSION = 'telescope_mount/tracking', 1
DAMAGED = 'state of a tracking filter is damaged'


def to_json(tracker):
    """All that a tracker is.

    Parameters
    ----------
    tracker : Tracker

    Returns
    -------
    str
        Floats as the shortest decimal numbers that give them back.
    """
    bank = tracker.bank
    return json.dumps({
        'format': FORMAT, 'version': VERSION, 'model': json.loads(model_to_json(tracker.plain)),
        'witnesses': tracker.witnesses, 'settings': asdict(tracker.settings),
        'given_weights': tracker.given_weights, 'stamp': tracker.stamp,
        'star': tracker.last_star, 'reference': tracker.reference,
        'confidence': tracker.confidence.state(), 'waiting': tracker.waiting,
        'said': tracker.said, 'notes': tracker.notes,
        'bank': {'home': bank.home.tolist(), **bank.state()}})


def of_json(text, make, mount=None):
    """A tracker from `to_json`.

    Parameters
    ----------
    text : str
    make : callable
        `Tracker`.
    mount : Mount, optional
        That is observed.

    Raises
    ------
    ValueError
        It is no such state, of a later version, damaged, or of another mount.
    """
    try:
        kept = json.loads(text)
    except ValueError as error:
        raise ValueError(f'state of a tracking filter is not JSON: {error}') from None
    if not isinstance(kept, dict) or kept.get('format') != FORMAT:
        raise ValueError(f'not the state of a tracking filter: no format {FORMAT!r}')
    if kept.get('version') != VERSION:
        raise ValueError(f'state of a tracking filter of version {kept.get("version")!r}, '
                         f'this program reads {VERSION}; begin anew')
    try:
        out = make(from_document(kept['model']), kept['stamp'], mount=mount,
                   witnesses=kept['witnesses'], settings=TrackingSettings(**kept['settings']),
                   rate_weights=kept['given_weights'])
        out.bank.home = np.array(kept['bank']['home'], dtype=float)
        out.bank.restore(kept['bank'])
        out.last_star, out.reference = kept['star'], kept['reference']
        out.confidence = Confidence.of_state(kept['confidence'])
        out.waiting = [tuple(pair) for pair in kept['waiting']]
        out.said = [tuple(pair) for pair in kept['said']]
        out.notes = kept['notes']
    except (KeyError, TypeError) as error:
        raise ValueError(f'{DAMAGED}: {error}') from None
    out.take_confidence()
    return out
