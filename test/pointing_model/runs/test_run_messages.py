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

import contextlib

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)

from msg_tools.units import DEG
from pointing_model.mounts import ALTAZ, Mount
from pointing_model.runs.run import PointingRun
from pointing_model.runs.run_messages import cloud_to_run, run_to_cloud

NS = 1_768_482_000_123_456_789


def run(n=3):
    rng = np.random.default_rng(1)
    names = ('az', 'el', 'az_enc', 'el_enc', 'star', 'time')
    columns = {name: rng.uniform(0.1, 1.5, n) for name in names}
    columns['time'] = NS * 1e-9 + rng.uniform(size=n)
    return PointingRun(columns)


def test_observations_keep_every_bit():
    rows = run()
    message = run_to_cloud(rows, NS)
    assert (message.height, message.width, len(message.data)) == (1, 3, message.row_step)
    back = cloud_to_run(message)
    assert list(back.columns) == list(rows.columns)
    for name in rows.columns:
        np.testing.assert_array_equal(back[name], rows[name])


@pytest.mark.parametrize('mount', [
    ALTAZ, Mount.equatorial(-31.05 * DEG), Mount.equatorial(0.6, 'german'),
    Mount.free(0.3, 0.2, 0.1)], ids=lambda mount: mount.kind)
def test_rows_know_their_mount(mount):
    rows = run()
    rows.meta['mount'] = mount
    message = run_to_cloud(rows, NS)
    back = cloud_to_run(message).mount
    assert back.kind == mount.kind
    np.testing.assert_allclose(back.frame, mount.frame, atol=1e-14)
    assert list(cloud_to_run(message).columns) == list(rows.columns)
    assert message.header.frame_id == 'mount_enu'
    # what is drawn is where it is on the sky
    steps = np.frombuffer(bytes(message.data), np.uint8).reshape(3, message.point_step)
    z = np.ascontiguousarray(steps[:, 8:12]).view('<f4')[:, 0]
    np.testing.assert_allclose(z, np.sin(mount.horizon_of(rows['az'], rows['el'])[1]), atol=1e-6)


@pytest.mark.parametrize('frame', ['mount_enu/german@', 'mount_enu/german', 'mount_enu/crane@3'])
def test_the_frame_of_an_older_log_names_the_mount(frame):
    message = run_to_cloud(run(), NS)
    message.header.frame_id = frame
    with pytest.raises(ValueError, match='frame_id .* of an observation'):
        cloud_to_run(message)
    message.header.frame_id = 'mount_enu/german@34.3'
    mount = cloud_to_run(message).mount
    assert mount.kind == 'german' and mount.latitude == pytest.approx(34.3 * DEG, abs=1e-14)
    message.header.frame_id = 'map'
    assert cloud_to_run(message).mount is ALTAZ


@pytest.mark.parametrize('number, pole', [(99.0, 0.5), (1.5, 0.5), (np.nan, 0.5), (1.0, np.nan)])
def test_rows_of_no_mount_are_refused(number, pole):
    rows = run()
    rows.columns |= {'mount_kind': np.full(3, number), 'pole_az': np.zeros(3),
                     'pole_el': np.full(3, pole), 'pole_roll': np.zeros(3)}
    with pytest.raises(ValueError, match='mount'):
        cloud_to_run(run_to_cloud(rows, NS))


def test_points_lie_on_the_sky_east_north_up():
    rows = PointingRun({'az': np.array([90.0, 0.0, 0.0]) * DEG, 'az_enc': np.zeros(3),
                        'el': np.array([0.0, 0.0, 90.0]) * DEG, 'el_enc': np.zeros(3)})
    message = run_to_cloud(rows, NS)
    assert message.header.frame_id == 'mount_enu'
    assert [f.name for f in message.fields[:3]] == ['x', 'y', 'z']
    steps = np.frombuffer(bytes(message.data), np.uint8).reshape(3, message.point_step)
    xyz = np.stack([np.ascontiguousarray(steps[:, f.offset:f.offset + 4]).view('<f4')[:, 0]
                    for f in message.fields[:3]], axis=1)
    np.testing.assert_allclose(xyz, np.eye(3), atol=1e-7)


def test_big_endian_and_foreign_fields():
    rows = run()
    message = run_to_cloud(rows, NS)
    doubles = np.frombuffer(bytes(message.data), np.uint8).reshape(3, message.point_step).copy()
    doubles[:, 16:] = doubles[:, 16:].reshape(3, -1, 8)[:, :, ::-1].reshape(3, -1)
    message.data, message.is_bigendian = doubles.tobytes(), True
    back = cloud_to_run(message)
    np.testing.assert_array_equal(back['el_enc'], rows['el_enc'])
    assert 'x' not in back


def test_bad_observations_are_refused():
    message = run_to_cloud(run(), NS)
    message.data = bytes(message.data)[:-1]
    with pytest.raises(ValueError, match='bytes for 3 rows'):
        cloud_to_run(message)
    message = run_to_cloud(run(), NS)
    message.fields = [f for f in message.fields if f.name != 'el_enc']
    with pytest.raises(ValueError, match='without float64 field el_enc'):
        cloud_to_run(message)
    message = run_to_cloud(run(), NS)
    message.fields[-1].offset = message.point_step
    with pytest.raises(ValueError, match='observation'):
        cloud_to_run(message)
    message = run_to_cloud(run(), NS)
    message.width, message.point_step = 2**31, 0
    with pytest.raises(ValueError, match='observation'):
        cloud_to_run(message)


def test_an_observation_without_rows_is_refused_or_empty():
    message = run_to_cloud(run(), NS)
    message.width, message.data = 0, b''
    with contextlib.suppress(ValueError):
        assert len(cloud_to_run(message)) == 0
