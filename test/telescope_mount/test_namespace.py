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

"""A log of a mount in another namespace says what that of the same night in the usual one does."""

import numpy as np
import pytest

from msg_tools.bag import BagReader, BagWriter
from msg_tools.bag.bag_pair import RECORD
from telescope_mount.commands.info import log_info
from telescope_mount.input_files.run_loader import run_of_log
from telescope_mount.log_check.log_check import verify_log

pytestmark = pytest.mark.usefixtures('ros_domain')


def moved(name):
    return name.replace('/mount/', '/north/')


@pytest.fixture(scope='module')
def north(night, tmp_path_factory):
    """As `namespace:=/north` records it."""
    from rclpy.serialization import deserialize_message, serialize_message

    from msg_tools.topics import DIAGNOSTICS
    old, path = BagReader(night / 'bag'), tmp_path_factory.mktemp('north') / 'bag'
    with BagWriter(path) as new:
        for topic in old.topics:
            definition = old.schema_of(topic.name, topic.type)[0].data
            new.add_foreign_topic(moved(topic.name), topic.type, topic.qos, definition)
        for name, record in old.metadata.items():
            if name.startswith(RECORD):
                new.add_metadata(moved(name), record)
        for message in old.messages():
            data = bytes(message.data)
            if message.topic == DIAGNOSTICS.name:
                array = deserialize_message(data, DIAGNOSTICS.message)
                for status in array.status:
                    status.name = moved(status.name)
                data = serialize_message(array)
            new.write(moved(message.topic), data, message.log_time, message.publish_time)
    return path


def test_it_is_read_and_fitted_alike(night, north):
    def counted(path):
        return {moved(topic['name']): topic['count'] for topic in log_info(path)['topics']}
    assert counted(north) == counted(night / 'bag')
    here, there = run_of_log(night / 'bag'), run_of_log(north)
    assert list(here.columns) == list(there.columns)
    for name in here.columns:
        np.testing.assert_array_equal(here[name], there[name], name)
    same = ('notes', 'excluded')
    assert [here.meta[name] for name in same] == [there.meta[name] for name in same]


def test_it_is_verified_alike(night, north):
    found = verify_log(north)
    assert found == verify_log(night / 'bag')
    assert found['checked']['model'] == 1 and not found['differences']


def test_it_is_replayed_to_the_bit(night, north, ended, tmp_path):
    assert ended('replay', north, '--seed', 3, '--save', tmp_path / 'model.json')[0] == 0
    assert (tmp_path / 'model.json').read_bytes() == (night / 'model.json').read_bytes()


def test_its_state_is_shown_without_naming_the_namespace(night, north, ended):
    codes, states = zip(*(ended('watch', log, '--once')[:2] for log in (night / 'bag', north)))
    assert codes == (0, 0) and 'zero' in states[0].lower()
    there = states[1].replace(str(north), str(night / 'bag'))
    assert '/north/' not in there.partition('warning')[0]
    # a slow start is a warning with the node's full name
    assert there.replace('/north/', '/mount/') == states[0]
