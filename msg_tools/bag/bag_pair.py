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

"""Distributes a logger's messages to two bags, with clock, pause and snapshot."""

import json
from collections import deque

from ..whole_files import reason
from .metadata import is_truth

#: most bytes that wait for the first /clock before they are written with their source times
BEFORE_CLOCK = 64 * 2**20
#: prefix of the MCAP metadata record with the parameters of a node
RECORD = 'parameters '


class Ring:
    """The newest messages, up to a total size, for a snapshot.

    Parameters
    ----------
    limit : int
        Most bytes of their data.
    """

    def __init__(self, limit):
        self._limit = limit
        self._rows = deque()
        self._size = 0

    def add(self, row, size):
        """Add a message; the oldest ones are dropped if needed."""
        self._rows.append((row, size))
        self._size += size
        while self._size > self._limit and len(self._rows) > 1:
            self._size -= self._rows.popleft()[1]

    def take(self):
        """Return all messages, oldest first, and empty the ring."""
        rows = [row for row, _ in self._rows]
        self._rows.clear()
        self._size = 0
        return rows


class BagPair:
    """Two bags, the second for the truth, which fit and diagnose refuse.

    Parameters
    ----------
    make_bag : callable
        ``make_bag(folder)`` returns a `BagWriter`.
    folder, truth_folder : str
        The second is created when it is needed.
    log
        Has ``warning(text)`` and ``error(text)``.
    snapshot_bytes : int
        Keep so much in memory and write it only on request; 0: write everything.

    Attributes
    ----------
    bag : BagWriter
        The first bag.
    error : str or None
        Why one or both of them have stopped; the other continues.
    written : int
        Number of messages.
    parameters : dict
        Node name -> parameters, see `add_parameters`.
    """

    def __init__(self, make_bag, folder, truth_folder, log, snapshot_bytes=0):
        self._make_bag, self._truth_folder, self._log = make_bag, truth_folder, log
        self._ring = Ring(snapshot_bytes) if snapshot_bytes else None
        self._paused = False
        self._held = {}  # latched messages that came while paused
        self._before_clock, self._before_size = [], 0
        self._bag_of = {}
        self._truth_bag = None
        self._stopped = {}  # bag -> reason
        self.written, self.parameters = 0, {}
        self.bag = make_bag(folder)

    @property
    def error(self):
        """Errors of disks, None if there are none."""
        return '; '.join(f'{bag.folder.name}: recording stopped: {why}'
                         for bag, why in self._stopped.items()) or None

    @property
    def state(self):
        """State in one word, for people."""
        return 'stopped' if self.bag in self._stopped else 'paused' if self._paused else (
            'snapshot' if self._ring is not None else 'recording')

    def add_topic(self, name, type_name, offers, hash_):
        """Declare a topic: arguments and errors as in `BagWriter.add_topic`."""
        bag = self.bag
        if is_truth(name):
            if self._truth_bag is None:
                self._truth_bag = self._make_bag(self._truth_folder)
                for node, values in self.parameters.items():
                    self._truth_bag.add_metadata(RECORD + node, values)
            bag = self._truth_bag
        bag.add_topic(name, type_name, offers, hash_)
        self._bag_of[name] = bag

    # --- messages ---------------------------------------------------------------------------

    def take(self, name, data, log_time, publish_time, sequence, latched):
        """Take a message; `log_time` is 0 until simulated time begins."""
        if log_time <= 0:
            # with simulated time nothing has a time of reception before the first /clock
            self._before_clock.append((name, data, publish_time, sequence, latched))
            self._before_size += len(data)
            if self._before_size > BEFORE_CLOCK:
                self._log.warning('no /clock: messages are written with the times of their sources')
                self._write_before(None)
            return
        if self._before_clock:
            self._write_before(log_time)
        self._sort((name, data, log_time, publish_time, sequence), latched)

    def _write_before(self, now):
        waiting, self._before_clock, self._before_size = self._before_clock, [], 0
        for name, data, publish_time, sequence, latched in waiting:
            # without any /clock the source's time is the best available
            when = max(0, publish_time) if now is None else now
            self._sort((name, data, when, publish_time, sequence), latched)

    def _sort(self, entry, latched):
        """Write a message, keep it for a snapshot, or skip it while paused."""
        if self._paused:
            if latched:
                self._held[entry[0]] = entry
        elif self._ring is not None:
            self._ring.add(entry, len(entry[1]) + 100)
        else:
            self._write(*entry)

    def _write(self, name, data, log_time, publish_time, sequence):
        bag = self._bag_of[name]
        if bag in self._stopped:
            return
        try:
            bag.write(
                name, data, log_time, publish_time if publish_time > 0 else 0, sequence or 0)
            self.written += 1
        except OSError as err:
            self._stop(bag, err)

    # --- what else is done to the bags --------------------------------------------------------

    def _bags(self):
        return [bag for bag in (self.bag, self._truth_bag) if bag is not None]

    def _guard(self, call):
        """Call a function for every bag that has not stopped; False if one has stopped."""
        for bag in self._bags():
            try:
                if bag not in self._stopped:
                    call(bag)
            except OSError as err:
                self._stop(bag, err)
        return not self._stopped

    def _stop(self, bag, err):
        self._stopped[bag] = reason(err)
        self._log.error(f'{bag.folder}: recording stopped: {reason(err)}; what was written before '
                        'is safe')

    def flush(self):
        """Close the chunks, so that they survive a crash; does not wait for the disk."""
        self._guard(lambda bag: bag.refresh(wait=False))

    def add_parameters(self, node, values, truth=()):
        """Write a metadata record with the parameters of a node into both bags.

        Parameters named in `truth` belong to the simulator's truth and are written only to its bag.
        """
        self.parameters[node] = values
        public = {name: text for name, text in values.items() if name not in truth}
        self._guard(lambda bag: bag.add_metadata(
            RECORD + node, public if bag is self.bag else values))

    def attach(self, name, media_type, data):
        """Add an attachment to the first bag."""
        self._guard(lambda bag: bag is self.bag and bag.add_attachment(name, media_type, data))

    def close(self, *attachments):
        """Write waiting messages, `attachments` (see `attach`), index and metadata.

        Raises
        ------
        OSError
            A bag is incomplete.
        """
        self._write_before(None)
        for attachment in attachments:
            self.attach(*attachment)
        for bag in self._bags():
            try:
                bag.close()
            except OSError as err:
                self._stopped.setdefault(bag, reason(err))
        if self._stopped:
            raise OSError(self.error)

    # --- services: whether it was done, and a sentence ----------------------------------------

    def pause(self):
        """Write nothing until `resume`."""
        self._paused = True
        return True, f'paused after {self.written} messages'

    def resume(self):
        """Continue, with the latched messages that arrived meanwhile."""
        self._paused = False
        held, self._held = self._held, {}
        for entry in held.values():
            self._sort(entry, True)
        return True, f'recording; {len(held)} latched messages that came meanwhile are taken'

    def is_paused(self):
        """Whether it is paused."""
        return self._paused, 'paused' if self._paused else 'recording'

    def split_bagfile(self):
        """Continue in new files."""
        if not self._guard(lambda bag: bag.split()):
            return False, self.error
        return True, f'recording goes on in {self.bag.file.name}'

    def snapshot(self):
        """Write the messages kept in memory."""
        if self._ring is None:
            return False, 'not in snapshot mode; start the logger with snapshot_mb above 0'
        rows = self._ring.take()
        for row in rows:
            self._write(*row)
        if not self._guard(lambda bag: bag.refresh()):
            return False, self.error
        return True, f'{len(rows)} messages written'


def parameters_of(metadata, suffix):
    """Parameters of the node whose full name ends with `suffix`, from a log's metadata.

    Parameters
    ----------
    metadata : dict of str to dict
        See `BagReader.metadata`.
    suffix : str
        For instance ``/calibration``.

    Returns
    -------
    dict or None
    """
    for name, record in metadata.items():
        if name.startswith(RECORD) and name.endswith(suffix):
            try:
                return {key: json.loads(text) for key, text in record.items()}
            except (ValueError, RecursionError):
                return None
    return None
