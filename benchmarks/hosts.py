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

"""Hosts on one machine: network namespaces with a link that loses and delays frames or is cut.

Needs Linux, root and `ip` (iproute2). A host has its own interfaces, ports and `/dev/shm`, so nodes
of two hosts share only the network. The link is two TAP devices between which this process copies
the frames: that works without the kernel's `netem`, and the same everywhere.
"""

import contextlib
import fcntl
import heapq
import os
import random
import shutil
import struct
import subprocess
import threading
import time

#: Linux: <linux/if_tun.h>
_TUNSETIFF, _IFF_TAP, _IFF_NO_PI = 0x400454CA, 0x0002, 0x1000
#: frames that wait in a device while the wire is slow
_QUEUE = 5000


def why_not():
    """Why hosts cannot be made on this machine, in a sentence; '' if they can."""
    if os.geteuid() != 0:
        return 'network namespaces need root'
    for tool in ('ip', 'nsenter'):
        if shutil.which(tool) is None:
            return f'no {tool} (apt install iproute2 util-linux)'
    name = f'tm{os.getpid()}'
    tried = subprocess.run(['ip', 'netns', 'add', name], capture_output=True, text=True)
    if tried.returncode:
        return f'no network namespaces: {tried.stderr.strip()}'
    subprocess.run(['ip', 'netns', 'del', name], check=True)
    return ''


def _ip(*words):
    subprocess.run(['ip', *words], check=True)


class Host:
    """A network namespace, with the processes that were started in it.

    Attributes
    ----------
    name, address : str
    """

    def __init__(self, name, address):
        self.name, self.address, self._keeper = name, address, None
        _ip('netns', 'add', name)
        try:
            _ip('-n', name, 'link', 'set', 'lo', 'up')
            # it holds the mounts of the host: all that is started in it has one /dev/shm
            self._keeper = subprocess.Popen(
                ['ip', 'netns', 'exec', name, 'sh', '-c',
                 'mount -t tmpfs tmpfs /dev/shm && echo up && exec cat'],  # as long as this process
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
            if self._keeper.stdout.readline() != 'up\n':
                raise OSError(f'host {name}: no /dev/shm of its own')
        except BaseException:
            self.close()
            raise

    def connect(self, device):
        """Move a network device into the namespace."""
        _ip('link', 'set', device, 'netns', self.name)
        _ip('-n', self.name, 'addr', 'add', f'{self.address}/24', 'dev', device)
        _ip('-n', self.name, 'link', 'set', device, 'up')
        _ip('-n', self.name, 'route', 'add', '224.0.0.0/4', 'dev', device)

    def inside(self, *command):
        """The command that runs `command` in it, list of str."""
        return ['nsenter', '-t', str(self._keeper.pid), '-m', '-n', f'--wd={os.getcwd()}', '--',
                *map(str, command)]

    def start(self, *command, **options):
        """Start a process in it, as `subprocess.Popen`."""
        return subprocess.Popen(self.inside(*command), **options)

    def close(self):
        """Remove the namespace; its processes must have ended."""
        if self._keeper is not None:
            self._keeper.kill()
            self._keeper.communicate()
        subprocess.run(['ip', 'netns', 'del', self.name], capture_output=True)


class Wire(threading.Thread):
    """Carries frames between two TAP devices.

    Parameters
    ----------
    names : (str, str)
        Of the devices.
    loss : float
        Share of frames that it loses, each way.
    delay : float
        s that a frame takes.
    seed : int
        Of what is lost.

    Attributes
    ----------
    up : bool
        False: the cable is pulled; frames on the way still come.
    carried, lost : int
        Frames.
    """

    def __init__(self, names, loss=0.0, delay=0.0, seed=1):
        super().__init__(daemon=True)
        self._ends = [self._tap(name) for name in names]
        self.loss, self.delay, self.up = loss, delay, True
        self.carried = self.lost = 0
        self._draw = random.Random(seed)
        self._stopped = threading.Event()

    @staticmethod
    def _tap(name):
        end = os.open('/dev/net/tun', os.O_RDWR | os.O_NONBLOCK)
        fcntl.ioctl(end, _TUNSETIFF, struct.pack('16sH', name.encode(), _IFF_TAP | _IFF_NO_PI))
        _ip('link', 'set', name, 'txqueuelen', str(_QUEUE))
        return end

    def run(self):
        """Until `close`."""
        import select
        under_way, number = [], 0
        while not self._stopped.is_set():
            wait = 0.1
            if under_way:
                wait = min(wait, max(0.0, under_way[0][0] - time.monotonic()))
            ready = select.select(self._ends, [], [], wait)[0]
            now = time.monotonic()
            for end in ready:
                other = self._ends[end == self._ends[0]]
                with contextlib.suppress(BlockingIOError):
                    for _ in range(100):
                        frame = os.read(end, 65536)
                        if not self.up or self._draw.random() < self.loss:
                            self.lost += 1
                            continue
                        number += 1
                        heapq.heappush(under_way, (now + self.delay, number, other, frame))
            while under_way and under_way[0][0] <= now:
                *_, end, frame = heapq.heappop(under_way)
                with contextlib.suppress(OSError):  # a host that has just gone
                    os.write(end, frame)
                    self.carried += 1

    def close(self):
        """End it; the devices go with it."""
        self._stopped.set()
        if self.is_alive():
            self.join()
        for end in self._ends:
            os.close(end)


@contextlib.contextmanager
def two_hosts(wire=None):
    """Two hosts on one network, 10.77.0.1 and 10.77.0.2.

    Parameters
    ----------
    wire : dict, optional
        As of `Wire`; without it the kernel's own, which loses nothing.

    Yields
    ------
    first, second : Host
    wire : Wire or None
    """
    tag = f'tm{os.getpid()}'
    devices = f'{tag}a', f'{tag}b'
    with contextlib.ExitStack() as stack:
        hosts = []
        for number, name in enumerate(devices, 1):
            hosts.append(Host(name, f'10.77.0.{number}'))
            stack.callback(hosts[-1].close)
        carrier = None
        if wire is None:
            _ip('link', 'add', devices[0], 'type', 'veth', 'peer', 'name', devices[1])
        else:
            carrier = Wire(devices, **wire)
            stack.callback(carrier.close)
            carrier.start()
        for host, device in zip(hosts, devices):
            host.connect(device)
        yield *hosts, carrier
