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

import json
import shutil

import pytest

from msg_tools.bag import BagReader, BagWriter
from pointing_model.model import PointingModel

pytestmark = pytest.mark.usefixtures('ros_domain')


def test_what_is_left_of_a_log_gives_the_same_model_to_the_bit(other_night, cli, tmp_path):
    """Only its end is missing: no index, and perhaps the last chunk. It has harmonics."""
    file = shutil.copy(next((other_night / 'bag').glob('*.mcap')), tmp_path / 'cut.mcap')
    with open(file, 'r+b') as stream:
        stream.truncate(file.stat().st_size - 100)
    assert not BagReader(file).complete
    before = file.read_bytes()
    out = tmp_path / 'model.json'
    done = cli('replay', file, '--seed', 3, '--save', out, '--verbose')
    assert (done.returncode, done.stderr) == (0, '')
    assert out.read_bytes() == (other_night / 'model.json').read_bytes()
    assert PointingModel.load(out).harmonics.interpretation == 'printed'
    report = json.loads((other_night / 'report.json').read_text())
    for step in report['steps']:
        assert f'{step["held_out"]["radial"]:.2f}' in done.stdout
    assert file.read_bytes() == before  # and the log is as it was


def test_marks_are_judged_again_and_other_harmonics_may_be_asked_for(other_night, ended, tmp_path):
    """In a log that was recorded in another namespace."""
    pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)
    from rclpy.serialization import serialize_message

    from msg_tools.convert import from_stamp
    from msg_tools.homing import cloud_to_homing, homing_to_cloud
    log = BagReader(other_night / 'bag')
    wanted = ['/mount/observation', '/mount/incremental/homing', '/mount/zero',
              '/mount/calibration/report']  # which says that there were harmonics

    def there(name):
        return name.replace('/mount/', '/dome/east/')
    with BagWriter(tmp_path / 'bag') as new:
        for topic in log.topics:
            if topic.name in wanted:
                definition = log.schema_of(topic.name, topic.type)[0].data
                new.add_foreign_topic(there(topic.name), topic.type, topic.qos, definition,
                                      topic.type_hash)
        for message in log.messages(wanted):
            data = message.data
            if message.topic == wanted[1]:
                told = log.decode(message)
                axes = [axis._replace(side=axis.side and 'above')
                        for axis in cloud_to_homing(told).values()]
                data = serialize_message(homing_to_cloud(axes, from_stamp(told.header.stamp)))
            new.write(there(message.topic), data, message.log_time, message.publish_time,
                      message.sequence)
    code, said, err = ended('replay', tmp_path / 'bag', '--seed', 3, '--harmonics', 'none',
                            '--save', tmp_path / 'plain.json')
    assert code == 0, err
    assert 'homed from above, not from below' in ' '.join(said.split())
    assert PointingModel.load(tmp_path / 'plain.json').harmonics is None


def test_logs_that_cannot_be_replayed(night, refused, tmp_path):
    assert 'does not exist' in refused('replay', tmp_path / 'absent')
    assert 'holds the truth of the simulator' in refused('replay', night / 'bag_truth')
    (tmp_path / 'empty').mkdir()
    assert 'holds no .mcap file' in refused('replay', tmp_path / 'empty')
    (tmp_path / 'text.mcap').write_text('this is no log')
    assert 'is not an MCAP file' in refused('replay', tmp_path / 'text.mcap')
    (tmp_path / 'nothing.mcap').write_text('')
    assert 'is empty' in refused('replay', tmp_path / 'nothing.mcap')
    file = next((night / 'bag').glob('*.mcap'))
    (tmp_path / 'cut.mcap').write_bytes(file.read_bytes()[:200])
    refused('replay', tmp_path / 'cut.mcap')


def test_the_model_cannot_be_written(night, refused, tmp_path):
    assert 'no such folder' in refused(
        'replay', night / 'bag', '--save', tmp_path / 'no' / 'model.json')


def test_a_reference_that_is_no_model(night, refused, tmp_path):
    (tmp_path / 'bad.json').write_text('{}')
    assert 'not a pointing model' in refused(
        'replay', night / 'bag', '--reference', tmp_path / 'bad.json')
