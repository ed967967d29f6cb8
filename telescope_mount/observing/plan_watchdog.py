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

"""What is wrong while a plan is under way: named, logged once a change, and when to give up."""

from .plan import VERBS

#: a wait of so long is reported, wall s: at the third look, half a second apart
REPORTED_AFTER = 0.9
WAITING = 'plan', 'waiting'


class PlanWatchdog:
    """Watches instruments and plan, names what is wrong, and gives up a plan that goes nowhere.

    Parameters
    ----------
    outbox
        As of a `Sequencer`.
    instruments : Instruments
    exposer : Exposer

    Attributes
    ----------
    faults : dict of tuple to str
        What is wrong now and what to do, a sentence each, by (instrument, kind).
    """

    def __init__(self, outbox, instruments, exposer):
        self._out, self._instruments, self._exposer = outbox, instruments, exposer
        self.faults = {}
        self._waits = '', 0.0  # for what, and since when, wall s
        self._well = None  # when something went on last, wall s
        self._rows = 0

    @property
    def sentences(self):
        """Of the faults, but for what is waited for."""
        return [text for key, text in self.faults.items() if key != WAITING]

    def rest(self):
        """Nothing is under way; returns whether something was wrong."""
        self._well = None
        return self._changed({})

    def look(self, now, begun, waits, verb, rows):
        """Name what is wrong.

        Parameters
        ----------
        now : float
            Wall time that goes on, s.
        begun : bool
            Whether the plan has got beyond waiting for the graph.
        waits : str
            What it waits for, '' for nothing.
        verb : str
            Of the step.
        rows : int
            Observations so far.

        Returns
        -------
        changed : bool
            Whether something else is wrong than before.
        reason : str
            Why the plan is to be given up, '' as long as it is not.
        """
        if begun:
            self._instruments.watch(self._out.value('answer_timeout_s'))
            self._exposer.watch(now)
        found = dict(self._instruments.health.sentences)
        # what the graph lacks comes and goes while it is discovered
        if waits.partition(':')[0] != self._waits[0].partition(':')[0]:
            self._waits = waits, now
        self._waits = waits, self._waits[1]
        if waits and now - self._waits[1] >= REPORTED_AFTER:
            found[WAITING] = f'waiting for {waits}'
        changed = self._changed(found)
        return changed, self._too_long(now, begun, verb, rows)

    def _changed(self, found):
        """One line for what is new and one for what is over."""
        log, before = self._out.get_logger(), self.faults
        self.faults = found
        for key, text in found.items():
            if key not in before or (key == WAITING and before[key] != text):
                log.warning(text)
        for key in before.keys() - found.keys():
            log.info(f'over: {before[key]}')
        return before.keys() != found.keys()

    def _too_long(self, now, begun, verb, rows):
        """Why to give up: nothing has gone on for long while something was wrong."""
        if (self._well is None or not self.faults or not begun or rows != self._rows
                or verb in VERBS and VERBS[verb].patient):
            self._well, self._rows = now, rows
            return ''
        limit = self._out.value('give_up_s')
        if not limit or now - self._well <= limit:
            return ''
        return (f'given up after {limit:g} s without an observation: '
                + '; '.join(self.faults.values()))
