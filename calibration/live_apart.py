"""Causes told apart beside the calibration of a night: what it asks for after each star."""

import json

import numpy as np

from pointing_model.apart import CANNOT, FORMAT, VERSION
from pointing_model.zero_drift import Following

from .session_diagnosis import stars_of

#: that a star may be asked for later; whether there is so much time knows who observes
HOURS = 8.0
#: rows beyond which each star would be judged too slowly to be worth it
MOST_ROWS = 2000


class LiveApart:
    """Judges the sets of the last diagnosis of a `CalibrationSession` with each star."""

    def __init__(self):
        self._apart = self._last = self._of = None
        self._diagnosed = self._forgotten = 0

    def begin(self, session, found, site, until=0):
        """Take a diagnosis.

        Parameters
        ----------
        session : CalibrationSession
            That has made it.
        found : session_diagnosis.Amended
        site : dict or None
            As of `session_diagnosis.amend`.
        until : int
            As of `CalibrationSession.diagnose`.

        Returns
        -------
        str
            What is asked for, JSON: `pointing_model.apart`.
        """
        from .analysis.diagnosis.discrimination import Discrimination
        self._apart, self._diagnosed = None, until or session.last_stamp
        self._of = found.zeros, site, Following.of(found.model)
        self._forgotten = session.taken.forgotten
        verdict = found.document['verdict']
        if verdict == 'ambiguous' and len(session) <= MOST_ROWS:
            try:
                self._apart = Discrimination(found.diagnosis, HOURS)
                return self._judged(session, until)
            except ValueError:
                pass  # curves alone, or of changes: no set of causes
        return self._told(self._diagnosed, {
            'state': 'nothing open', 'says': f'the diagnosis leaves no causes to tell apart: '
            f'{verdict}', 'request': None, 'sets': []})

    def observed(self, session):
        """After rows have come, the same as `begin`; '' where nothing is asked."""
        return self._judged(session) if self._apart else ''

    def _judged(self, session, until=0):
        try:
            if session.taken.forgotten != self._forgotten:
                raise ValueError('some that were diagnosed are of a power-on that is not kept any '
                                 'more (kept_power_ons); diagnose again')
            told = self._apart.judge(stars_of(session.observations(until), *self._of)).to_dict()
        except (ValueError, np.linalg.LinAlgError) as err:
            told = {'state': CANNOT, 'says': f'the stars cannot be judged: {err}',
                    'request': None, 'sets': []}
        if told['request'] is None:
            self._apart = None
        return self._told(until or session.last_stamp, told)

    def _told(self, stamp, told):
        self._last = {'format': FORMAT, 'version': VERSION, 'last_stamp_ns': stamp,
                      'diagnosed_ns': self._diagnosed, **told}
        return json.dumps(self._last)

    def details(self):
        """Of the node's diagnostics."""
        return [('causes told apart', self._last['says'])] if self._last else []
