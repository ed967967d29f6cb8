"""Messages of a chunk, in log time order."""

import struct
from array import array

from mcap.opcode import Opcode

from .mcap_records import walk


class ChunkRows:
    """The chosen messages of a chunk, in log time order; bytes are cut out when asked for."""

    __slots__ = ('times', '_begins', '_ends', '_buffer', '_chosen', 'size')

    def __init__(self, buffer, chosen, low, high, most):
        self._buffer, self._chosen, self.size = buffer, chosen, len(buffer)
        times, begins, ends = array('Q'), array('Q'), array('Q')
        unpack = struct.Struct('<HIQ').unpack_from
        ordered, last = True, 0
        for opcode, begin, end in walk(buffer, most):
            if opcode != Opcode.MESSAGE or end - begin < 22:
                continue
            channel, _, log_time = unpack(buffer, begin)
            if channel in chosen and low <= log_time < high:
                times.append(log_time)
                begins.append(begin)
                ends.append(end)
                ordered = ordered and log_time >= last
                last = log_time
        if not ordered:
            order = sorted(range(len(times)), key=times.__getitem__)
            times = array('Q', [times[i] for i in order])
            begins = array('Q', [begins[i] for i in order])
            ends = array('Q', [ends[i] for i in order])
        self.times, self._begins, self._ends = times, begins, ends

    def __len__(self):
        return len(self.times)

    def __lt__(self, other):
        return False  # ties in the heap end with the order of the file

    def between(self, number, stop):
        """(what `chosen` holds, (log time, publish time, data, sequence)) of rows."""
        buffer, chosen = self._buffer, self._chosen
        unpack = struct.Struct('<HIQQ').unpack_from
        for begin, end in zip(self._begins[number:stop], self._ends[number:stop]):
            channel, sequence, log_time, publish_time = unpack(buffer, begin)
            yield chosen[channel], (log_time, publish_time, buffer[begin + 22:end], sequence)
