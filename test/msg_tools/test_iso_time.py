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

"""Times in ISO 8601: leap seconds, and what programs write in place of the next minute."""

import numpy as np
import pytest

from msg_tools.iso_time import iso_ns, iso_seconds, read_iso

NEW_YEAR = 1483228800  # 2017-01-01, after a leap second


@pytest.mark.parametrize('text, seconds', [
    ('2016-12-31T23:59:60Z', NEW_YEAR), ('2016-12-31T23:59:60.250Z', NEW_YEAR + 0.25),
    ('2017-01-01T00:59:60.25+01:00', NEW_YEAR + 0.25), ('2016-12-31T24:00:00Z', NEW_YEAR),
    ('2016-12-31 24:00', NEW_YEAR), ('2017-01-01', NEW_YEAR),
    ('2017-01-01T05:29:60.000Z', NEW_YEAR + 19800), ('2017-01-01T00:00:01,5Z', NEW_YEAR + 1.5),
    ('2016-12-31T16:00:00-0800', NEW_YEAR),
    ('2016-02-28T24:00:00.000Z', 1456704000)])
def test_second_60_and_hour_24_are_the_next_minute_and_day(text, seconds):
    assert iso_seconds(text) == seconds
    assert iso_ns(f' {text} ') == round(seconds * 100) * 10_000_000


@pytest.mark.parametrize('text', [
    '2016-12-31T23:59:61Z', '2016-12-31T24:00:01Z', '2016-12-31T24:00:00.5Z', '2016-12-31T25:00Z',
    '2016-12-31T10:60:00Z', '2016-02-30', '2016-13-01T00:00:00Z', '10:20:30', '2016-12-31T10:20.5',
    'now', ''])
def test_what_is_no_time(text):
    whole, fraction = read_iso(['2017-01-01T00:00:00.5Z', text])
    assert whole.tolist() == [NEW_YEAR, 0] and fraction[0] == 0.5 and np.isnan(fraction[1])
    with pytest.raises(ValueError, match='is no date; write 2026'):
        iso_seconds(text)
