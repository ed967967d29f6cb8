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

import itertools
import random

import pytest

from msg_tools.gaps import SequenceGaps


def count(numbers, **options):
    gaps = SequenceGaps(**options)
    for number in numbers:
        gaps.add(number)
    return gaps.gaps, gaps.publishers


@pytest.mark.parametrize('numbers, expected', [
    ([1, 2, 3], (0, 1)),
    ([1, 2, 5, 6], (2, 1)),
    ([7, 8, 9], (0, 1)),  # matched late
    ([1, 2, 3, 1, 2], (0, 2)),  # started anew
    ([1, 1, 2, 2, 3, 3], (0, 2)),
    ([1, 1, 2, 2, 4, 3], (1, 2)),  # one of the two lost its third
    ([0, None, 1, 0, 2], (0, 1)),
    ([10, 11, 500, 12, 501, 13], (0, 2)),  # the second was there long before
    ([10, 11, 500, 501], (488, 1)),
    ([], (0, 0)),
])
def test_losses_and_publishers(numbers, expected):
    assert count(numbers) == expected


def test_a_latched_topic_may_skip():
    assert count([1, 5, 9], latched=True) == (0, 1)


def test_whoever_was_not_heard_yet_begins_somewhere():
    gaps = SequenceGaps()
    gaps.present = lambda: 3
    for number in (170, 40, 3000, 171, 41, 3001):  # a listener that comes late
        gaps.add(number)
        assert gaps.gaps == 0
    assert gaps.publishers == 3
    gaps.add(45)
    assert (gaps.gaps, gaps.publishers) == (3, 3)


def test_interleaved_publishers_with_losses():
    """The total is right as long as no publisher overtakes another by its losses."""
    rng = random.Random(4)
    for _ in range(50):
        streams = [[n for n in range(1, 200) if n == 1 or n == 199 or rng.random() > 0.02]
                   for _ in range(3)]
        lost = sum(199 - len(s) for s in streams)
        # one after the other
        assert count(itertools.chain(*streams)) == (lost, 3)


def test_interleaved_publishers_without_losses():
    rng = random.Random(5)
    streams = [iter(range(1, 300)) for _ in range(5)]
    numbers = []
    while streams:
        stream = rng.choice(streams)
        number = next(stream, None)
        if number is None:
            streams.remove(stream)
        else:
            numbers.append(number)
    assert count(numbers) == (0, 5)


def test_publishers_that_were_there_long_before_have_hardly_lost_anything():
    """As a logger finds them that is started last: each somewhere in its numbers.

    Whether a small jump is a loss, numbers without names cannot always tell.
    """
    rng = random.Random(6)
    lost = []
    for _ in range(200):
        following = [rng.randrange(1, 600) for _ in range(rng.randrange(2, 9))]
        numbers = []
        for _ in range(40 * len(following)):
            i = rng.randrange(len(following))
            numbers.append(following[i])
            following[i] += 1
        lost.append(count(numbers)[0])
    assert sum(lost) < 0.5 * len(lost) and max(lost) < 10
