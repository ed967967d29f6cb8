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

from types import SimpleNamespace

import pytest

from msg_tools.node import INSTANCE, earlier_duplicate, new_instance

EARLY, LATE = new_instance(10**18), new_instance(2 * 10**18)


def status(instance, name='/mount/camera', topics=('/mount/zero',)):
    """What a node reports of itself."""
    rows = {INSTANCE: instance} if instance else {}
    rows |= {f'publishes {topic}': '1' for topic in topics}
    return SimpleNamespace(name=name, values=[
        SimpleNamespace(key=key, value=value) for key, value in rows.items()])


def rival(own, other):
    return earlier_duplicate(own, '/mount/calibration', ['/mount/model', '/mount/zero'], other)


def test_of_two_publishers_the_one_that_started_later_goes():
    assert rival(LATE, status(EARLY)).startswith('/mount/zero is published by /mount/camera (')
    assert 'process' in rival(LATE, status(EARLY))
    assert rival(EARLY, status(LATE)) == ''


def test_of_two_that_started_at_once_one_goes():
    one, other = new_instance(7), new_instance(7)
    assert bool(rival(one, status(other))) != bool(rival(other, status(one)))


def test_the_order_is_that_of_numbers():
    assert rival(new_instance(10), status(new_instance(9)))


def test_two_of_one_name_are_rivals_without_a_common_topic():
    other = status(EARLY, '/mount/calibration', ())
    assert 'is running already' in rival(LATE, other)


@pytest.mark.parametrize('other', [
    status(LATE), status(EARLY, topics=['/mount2/zero']), status(EARLY, topics=['/mount/zero2']),
    status(EARLY, topics=()), status(''), status('of another program')])
def test_no_rival(other):
    assert rival(LATE, other) == ''


def test_an_instance_that_is_no_time_is_no_rival():
    assert rival(LATE, status('9' * 5000 + ' somewhere')) == ''
