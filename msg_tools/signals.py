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

"""Signals for a clean end: Ctrl-C, SIGTERM, and SIGHUP when a terminal is closed."""

import signal

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def on_end(handler):
    """Have `handler` called for each signal of `ENDING`.

    Ctrl-C is also handled where a shell without a terminal makes a process ignore it, since launch
    ends nodes with it. SIGHUP is not handled if it is ignored (nohup).

    Parameters
    ----------
    handler : callable
        See `signal.signal`.
    """
    for number in ENDING:
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, handler)
