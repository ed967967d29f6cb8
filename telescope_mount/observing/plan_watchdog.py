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

"""Faults during a plan: reported and logged once per change, with a time limit for the plan."""

from .plan import VERBS

#: longer waits are reported, wall s: at the third check, half a second apart
REPORTED_AFTER = 0.9
WAITING = 'plan', 'waiting'


class PlanWatchdog:
    """Watches instruments and plan, reports faults, and gives up a plan without progress.

    Parameters
    ----------
    outbox
        See `Sequencer`.
    instruments : Instruments
    exposer : Exposer

    Attributes
    ----------
    faults : dict of tuple to str
        Present faults and what to do, one sentence each, by (instrument, kind).
    """

    def __init__(self, outbox, instruments, exposer):
        self._out, self._instruments, self._exposer = outbox, instruments, exposer
        self.faults = {}
        self._waits = '', 0.0  # what is waited for, and since when, wall s
        self._well = None  # time of the last progress, wall s
        self._rows = 0

    @property
    def sentences(self):
        """Sentences of the faults, except for waits."""
        return [text for key, text in self.faults.items() if key != WAITING]

    def rest(self):
        """No plan is under way; returns whether there was a fault."""
        self._well = None
        return self._changed({})

    def look(self, now, begun, waits, verb, rows):
        """Report faults.

        Parameters
        ----------
        now : float
            Monotonic wall time, s.
        begun : bool
            Whether the plan has passed the wait for the graph.
        waits : str
            What the plan waits for, '' if nothing.
        verb : str
            Verb of the step.
        rows : int
            Number of observations so far.

        Returns
        -------
        changed : bool
            Whether the faults have changed.
        reason : str
            Why the plan must be given up, '' otherwise.
        """
        if begun:
            self._instruments.watch(self._out.value('answer_timeout_s'))
            self._exposer.watch(now)
        found = dict(self._instruments.health.sentences)
        # what the graph lacks changes during discovery
        if waits.partition(':')[0] != self._waits[0].partition(':')[0]:
            self._waits = waits, now
        self._waits = waits, self._waits[1]
        if waits and now - self._waits[1] >= REPORTED_AFTER:
            found[WAITING] = f'waiting for {waits}'
        return self._changed(found), self._too_long(now, begun, verb, rows)

    def _changed(self, found):
        """Log one line for each new fault and one for each that is over."""
        log, before = self._out.get_logger(), self.faults
        self.faults = found
        for key, text in found.items():
            if key not in before or (key == WAITING and before[key] != text):
                log.warning(text)
        for key in before.keys() - found.keys():
            log.info(f'over: {before[key]}')
        return before.keys() != found.keys()

    def _too_long(self, now, begun, verb, rows):
        """Why to give up: no progress for a long time during a fault."""
        if (self._well is None or not self.faults or not begun or rows != self._rows
                or verb in VERBS and VERBS[verb].patient):
            self._well, self._rows = now, rows
            return ''
        limit = self._out.value('give_up_s')
        if not limit or now - self._well <= limit:
            return ''
        return (f'given up after {limit:g} s without an observation: '
                + '; '.join(self.faults.values()))
