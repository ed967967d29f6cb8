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

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)

from msg_tools.cloud_tables import cloud_to_table, table_to_cloud
from msg_tools.homing import AxisHoming, cloud_to_homing, homing_to_cloud
from msg_tools.power_on import PowerOn
from msg_tools.units import ARCSEC

NS = 1_768_482_000_123_456_789
AZIMUTH = AxisHoming(True, 'below', 0, 2, -120.0, 0.0686 * ARCSEC, 3.0 * ARCSEC, 1,
                     1_768_482_000.5, 4.93, -3.5)
ELEVATION = AxisHoming(False, '', 3, 0, np.nan, 0.0686 * ARCSEC, np.nan, 2)


def test_homing_goes_there_and_back():
    message = homing_to_cloud([AZIMUTH, ELEVATION], NS)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == divmod(NS, 10**9)
    back = cloud_to_homing(message)
    assert list(back) == ['azimuth', 'elevation']
    assert back['azimuth'] == AZIMUTH
    assert back['elevation'][:4] == ELEVATION[:4] and np.isnan(back['elevation'].mark_error)
    above = cloud_to_homing(homing_to_cloud([AZIMUTH._replace(side='above'), ELEVATION], NS))
    assert above['azimuth'].side == 'above'
    assert type(above['azimuth'].homed) is bool and type(above['azimuth'].passages) is int


def test_the_fields_that_others_read():
    # a driver of a real encoder publishes these: a change of them is one of the interface
    assert [field.name for field in homing_to_cloud([AZIMUTH, ELEVATION], NS).fields] == [
        'axis', 'homed', 'side', 'missed_marks', 'passages', 'mark_error', 'count', 'pulse_width',
        'power_on', 'started', 'supply', 'temperature']


def test_an_encoder_of_one_axis_and_more_than_we_ask_for():
    table = cloud_to_table(homing_to_cloud([AZIMUTH, ELEVATION], NS))
    table = {name: values[1:] for name, values in table.items()} | {'humidity': [0.5]}
    assert list(cloud_to_homing(table_to_cloud(table, NS))) == ['elevation']


def test_a_message_of_an_older_log_does_not_say_when_the_power_on_began():
    table = cloud_to_table(homing_to_cloud([AZIMUTH, ELEVATION], NS))
    for name in ('started', 'supply', 'temperature'):
        del table[name]
    back = cloud_to_homing(table_to_cloud(table, NS))
    assert back['azimuth'][:-3] == AZIMUTH[:-3] and back['azimuth'].identity is None
    assert np.isnan(back['azimuth'].supply) and np.isnan(back['azimuth'].temperature)
    assert AZIMUTH.identity == PowerOn(1, 1_768_482_000.5)


@pytest.mark.parametrize('name', ['axis', *AxisHoming._fields[:-3]])
def test_a_field_that_is_missing_is_told(name):
    table = cloud_to_table(homing_to_cloud([AZIMUTH, ELEVATION], NS))
    del table[name]
    with pytest.raises(ValueError, match=f'homing without float64 field {name}'):
        cloud_to_homing(table_to_cloud(table, NS))


@pytest.mark.parametrize('name, value', [
    ('axis', 2.0), ('axis', np.nan), ('homed', 0.5), ('side', 2.0), ('missed_marks', np.nan),
    ('passages', np.inf), ('count', np.nan), ('power_on', 1.5),
    ('mark_error', np.inf), ('mark_error', 1e300), ('count', 1e300), ('missed_marks', 1e300),
    ('pulse_width', np.inf), ('started', np.inf), ('supply', -np.inf)])
def test_numbers_that_are_none_are_refused(name, value):
    table = cloud_to_table(homing_to_cloud([AZIMUTH, ELEVATION], NS))
    table[name][0] = value
    with pytest.raises(ValueError, match='homing: .* out of range'):
        cloud_to_homing(table_to_cloud(table, NS))
