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

"""Unreadable parts of a log: their bytes, number of messages and times."""

from datetime import datetime, timedelta, timezone
from typing import NamedTuple

#: 1980 and 2100, ns since 1970: other times are implausible in a log with times between these
EARLIEST, LATEST = 315_532_800 * 10**9, 4_102_444_800 * 10**9


class Lost(NamedTuple):
    """An unreadable part of a file.

    `counts` are the messages that the index lists, by channel; `known` if these are all.
    """

    offset: int
    length: int
    why: str
    counts: dict
    known: bool
    start: int | None = None
    end: int | None = None

    def __str__(self):
        size = f'{self.length} bytes at byte {self.offset} are damaged ({self.why})'
        if self.known and not self.counts:
            return f'{size}; no message is in them'
        return f'{size} and left out: {counted(sum(self.counts.values()), self.known)}' + (
            '' if self.start is None else f' {span(self.start, self.end)}')


def counted(count, known):
    """A number of messages in words, if not all of them may be known."""
    if not known:
        return f'at least {count} messages' if count else 'an unknown number of messages'
    return f'{count} message{"s" * (count != 1)}'


def utc(ns):
    """ISO 8601 of ns since 1970; None for None."""
    if ns is None:
        return None
    try:
        when = datetime(1970, 1, 1, tzinfo=timezone.utc) + timedelta(microseconds=ns // 1000)
    except OverflowError:
        return f'{ns} ns since 1970'
    return when.isoformat(timespec='milliseconds').replace('+00:00', 'Z')


def span(start, end):
    """A time span in words, from ns since 1970."""
    return f'from {utc(start)} to {utc(end)}'


def implausible(start, end):
    """What is wrong with the first and last time of a log, ns since 1970; '' if nothing.

    A simulated clock may start at 0, so the times are compared with each other.
    """
    if start is None or not (end > LATEST or start < EARLIEST <= end):
        return ''
    return (f'its times run {span(start, end)}: damage, or a clock that was not set')
