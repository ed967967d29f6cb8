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

"""Messages that were lost on the way, by the publishers' sequence numbers."""

#: jumps that may yet turn out to be another publisher
_JUMPS = 64
#: messages; so many are rarely lost at once: where publishers are found late, each somewhere in its
#: numbers, 0.1 are counted as lost on the mean (270 if no jump is given back, 1.3 with 16)
_FAR = 4


class SequenceGaps:
    """Counts what is missing in the sequence numbers of a topic.

    The numbers come without the name of the publisher, so each is taken as the next of the
    publisher that it fits best. A jump is a loss, until the number before it comes after all:
    then it was the first message from a publisher that was found late. As long as fewer publishers
    were received than there are, it is the first message of one of these.

    Parameters
    ----------
    latched : bool
        A latched topic keeps the last message only: that earlier ones are skipped is no loss.

    Attributes
    ----------
    gaps : int
        Messages lost.
    publishers : int
        Publishers distinguished, those that were started anew counted again.
    present : callable or None
        Says how many publishers there are now, where that is known.
    """

    def __init__(self, latched=False):
        self.gaps = 0
        self.publishers = 0
        self.present = None
        self._latched = latched
        self._next = {}  # number expected -> publishers that it is expected from
        self._jumps = {}

    def add(self, number):
        """Take the sequence number of a message; 0 or None says nothing."""
        if not number:
            return
        following = self._next
        if number in following:
            if following[number] == 1 and number + 1 not in following:  # nearly every message
                del following[number]
                following[number + 1] = 1
            else:
                self._move(number, number + 1)
            return
        below = None if number == 1 else max((n for n in following if n < number), default=None)
        # who was thought to have jumped far has not: hardly that another lost as many as lead here
        jump = self._jumps.get(number, 0)
        if below is None or jump >= _FAR or self._one_more():
            self._begin(number)
            return
        self._move(below, number + 1)
        if not self._latched:
            self.gaps += number - below
            if len(self._jumps) < _JUMPS:
                self._jumps[below] = number - below

    def _one_more(self):
        return self.present is not None and sum(self._next.values()) < self.present()

    def _begin(self, number):
        self.publishers += 1
        self.gaps -= self._jumps.pop(number, 0)
        self._next[number + 1] = self._next.get(number + 1, 0) + 1

    def _move(self, old, new):
        self._next[old] -= 1
        if not self._next[old]:
            del self._next[old]
        self._next[new] = self._next.get(new, 0) + 1
