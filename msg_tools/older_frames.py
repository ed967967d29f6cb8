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

"""Extra information in the ``frame_id`` of messages in older logs, and of older drivers.

Today a ``frame_id`` is a link of the URDF. Then it gave the power-on of a reading
(``power_on_2@1768482000.500``); for a zero also the model, and that it was not measured by Polaris
(``power_on_2@1768482000.500/3f2a90c1d5e7+stars``); the mount of an observation
(``mount_enu/german@34.3``, the latitude in deg); and y of a vector on the sky pointed up.
"""

import re

_PREFIX, _MOUNT = 'power_on_', 'mount_enu/'
_NUMBER, _START = _PREFIX + r'(-?\d+)', r'@(\d+(?:\.\d+)?)'
_POWER_ON = re.compile(_NUMBER + _START)
_ZERO = re.compile(rf'{_NUMBER}(?:{_START})?(?:/(\w+))?(?:\+(stars))?')


def power_on_in(frame):
    """Number and start (UTC s) of the power-on of a reading; None if the frame has none."""
    found = _POWER_ON.fullmatch(frame)
    return None if found is None else (int(found[1]), float(found[2]))


def zero_in(frame):
    """Power-on, its start (UTC s), model and way of a zero; None if the frame holds nothing.

    Only the power-on is never None.

    Raises
    ------
    ValueError
        It has no valid power-on.
    """
    if not frame.startswith(_PREFIX):
        return None
    found = _ZERO.fullmatch(frame)
    if found is None:
        raise ValueError(f'zero of {frame!r}: no number of a power-on')
    run, started, model, by = found.groups()
    return int(run), None if started is None else float(started), model, by


def mount_in(frame):
    """Kind and latitude (deg) of the mount of an observation; None for an alt-azimuth mount.

    Raises
    ------
    ValueError
        It has no latitude.
    """
    if not frame.startswith(_MOUNT) or frame == _MOUNT:
        return None
    kind, _, latitude = frame.removeprefix(_MOUNT).rpartition('@')
    return kind, float(latitude)


def is_y_up(frame):
    """Whether y of a vector on the sky points up, not down as in an optical frame."""
    return not frame.endswith('_optical')
