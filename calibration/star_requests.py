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

"""Stars requested by the calibration of a night, to discriminate between causes."""

import json

import numpy as np

from pointing_model.calibration_messages import CANNOT, CAUSES_FORMAT, CAUSES_VERSION

from .report.wording import worded
from .rows import stars_without_zeros

#: latest time of a requested star, in hours; only the observer knows whether there is so much time
HOURS = 8.0
#: most rows: with more each test would be too slow
MOST_ROWS = 2000


class StarRequests:
    """Tests the sets of causes of the last diagnosis with each new star.

    Attributes
    ----------
    document : dict or None
        State of the causes, and the requested star: see `pointing_model.calibration_messages`.
    """

    def __init__(self):
        self.document, self._news = None, ''
        self._causes = self._stars = None
        self._diagnosed = self._forgotten = 0

    def news(self):
        """`document` as JSON, only once; '' if nothing is new."""
        text, self._news = self._news, ''
        return text

    def begin(self, state, found, site, until=0):
        """Start with a diagnosis.

        Parameters
        ----------
        state : CalibrationState
            State of the diagnosed night.
        found : NightDiagnosis
        site : dict or None
            See `diagnose_night`.
        until : int
            See `CalibrationState.find_effects`.
        """
        from .analysis.diagnosis.discrimination import Discrimination
        self._diagnosed, self._forgotten = until or state.last_stamp, state.rows.forgotten
        self._causes, self._stars = None, (found.chosen.zeros, site, found.chosen.follows)
        verdict = found.document['verdict']
        if verdict == 'ambiguous' and len(state.observations()) <= MOST_ROWS:
            try:
                self._causes = Discrimination(found.diagnosis, HOURS)
            except ValueError:
                pass  # only curves or changes: no set of causes
            else:
                self.update(state, until)
                return
        self._set_document(self._diagnosed, {
            'state': 'nothing open', 'says': f'the diagnosis leaves no causes to distinguish: '
            f'{verdict}', 'request': None, 'sets': []})

    def update(self, state, until=0):
        """Test the causes with all rows so far, if they are still undecided."""
        if self._causes is None:
            return
        try:
            if state.rows.forgotten != self._forgotten:
                raise ValueError('some that were diagnosed are of a power-on that is not kept any '
                                 'more (kept_power_ons); diagnose again')
            found = worded(self._causes.compare(
                stars_without_zeros(state.observations(until), *self._stars)).to_dict())
        except (ValueError, np.linalg.LinAlgError) as err:
            found = {'state': CANNOT, 'says': f'the stars cannot be judged: {err}',
                     'request': None, 'sets': []}
        if found['request'] is None:
            self._causes = None
        self._set_document(until or state.last_stamp, found)

    def _set_document(self, stamp, found):
        self.document = {'format': CAUSES_FORMAT, 'version': CAUSES_VERSION, 'last_stamp_ns': stamp,
                         'diagnosed_ns': self._diagnosed, **found}
        self._news = json.dumps(self.document)
