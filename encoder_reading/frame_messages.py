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

"""Frames of an absolute encoder as ROS images, and the inverse."""

import array

import numpy as np

from msg_tools import convert, topics

#: mono8 and the name that OpenCV has for it
_ENCODINGS = ('mono8', '8UC1')


def frame_message(stamp, frames):
    """A mono8 image with one row per reading head: first axis, then second.

    Parameters
    ----------
    stamp : int
        ns.
    frames : sequence of ndarray of uint8, shape (heads, pixels)
        Frames of each axis; rows of a shorter CCD are padded with 0.
    """
    rows = np.zeros((sum(map(len, frames)), max(part.shape[1] for part in frames)), np.uint8)
    first = 0
    for part in frames:
        rows[first : first + len(part), : part.shape[1]] = part
        first += len(part)
    return topics.ABSOLUTE_FRAME.message(
        header=convert.header(stamp, convert.MOUNT_FRAME), height=rows.shape[0],
        width=rows.shape[1], encoding='mono8', is_bigendian=0, step=rows.shape[1],
        data=array.array('B', rows.tobytes()))


def read_frame(message, axes):
    """The inverse of `frame_message`.

    Parameters
    ----------
    message : sensor_msgs.msg.Image
        Its rows may be padded (`step`).
    axes : sequence of axis_reader.AxisReader

    Returns
    -------
    stamp : int
        ns.
    frames : list of ndarray of uint8, shape (heads, pixels)
        Frames of each axis, views of the message.

    Raises
    ------
    ValueError
        Not 8-bit grey, wrong number of rows or columns, truncated, or without a stamp.
    """
    heads = [axis.design.heads for axis in axes]
    width = max(axis.design.pixels for axis in axes)
    if message.encoding not in _ENCODINGS:
        raise ValueError(f'image in {message.encoding!r}: need {_ENCODINGS[0]}')
    if (message.height, message.width) != (sum(heads), width):
        raise ValueError(
            f'image of {message.height} rows, {message.width} columns: need {sum(heads)} rows (a '
            f'reading head each: {heads[0]} of {axes[0].axis}, then {heads[1]} of '
            f'{axes[1].axis}), {width} columns')
    if message.step < width or len(message.data) != message.height * message.step:
        raise ValueError(f'image of {len(message.data)} bytes in {message.height} rows of '
                         f'{message.step}: need that many, and {width} or more a row')
    stamp = convert.from_stamp(message.header.stamp)
    if stamp <= 0:
        raise ValueError('image without a stamp')
    rows = np.frombuffer(message.data, dtype=np.uint8).reshape(message.height, message.step)
    return stamp, [rows[:heads[0], :axes[0].design.pixels],
                   rows[heads[0]:, :axes[1].design.pixels]]
