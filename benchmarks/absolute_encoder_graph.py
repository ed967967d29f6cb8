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

"""The absolute encoder in the graph: two axes at 1 kHz, its node on one core.

    python benchmarks/absolute_encoder_graph.py [--seconds S] [--rate HZ] [--core N]
                                                [--realtime] [--frames] [--quick] [--json FILE]

Three processes and real DDS. One publishes true axis angles with the stamp of that moment. The
node `absolute_encoder`, pinned to one core, renders the image of both discs and reads it. This
process takes the readings off the wire, with the time at which each arrives.

Latency is from the stamp to the arrival here: two passes through DDS, the rendering of two frames
(which a real CCD would not need), the reading of both, and the scheduling of the machine. A
reading is lost if a published stamp never comes back. For comparison, the latency of the true
angles, one pass through DDS to this process, is the cost without the node. On a busy machine
--realtime (as root) gives the processes real-time scheduling, as on a control computer. CPU is the
time of the node's process: above 1 ms per sample it cannot keep up at 1 kHz. With --frames a
separate process only renders the frames, and the node `frame_reader` is pinned and measured, as
with a real CCD.
"""

import argparse
import json
import os
import select
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

PATIENCE = 60.0
TARGET_MS = 5.0
_RATES = (0.02, -0.01)  # of the axes, rad/s


def publish(rate, seconds):
    """Child process: warm up until told to go, then publish `seconds` at `rate`; print stamps."""
    import rclpy
    from rclpy.duration import Duration
    from rclpy.node import Node

    from msg_tools import NAMESPACE, convert, topics
    rclpy.init()
    node = Node('truth_source', namespace=NAMESPACE, enable_rosout=False,
                start_parameter_services=False)
    pub = node.create_publisher(
        topics.TRUTH_JOINTS.message, topics.TRUTH_JOINTS.name, topics.TRUTH_JOINTS.qos)
    deadline = time.monotonic() + PATIENCE
    while pub.get_subscription_count() == 0 and time.monotonic() < deadline:
        time.sleep(0.02)  # polls; nothing is measured yet
    start = time.time_ns()

    def sample():
        stamp = time.time_ns()
        past = (stamp - start) * 1e-9
        pub.publish(convert.joint_state(
            stamp, (1.0 + _RATES[0] * past, 0.7 + _RATES[1] * past), _RATES))
        return stamp

    while not select.select([sys.stdin], [], [], 0.02)[0]:
        sample()
    if not sys.stdin.readline():
        return  # the other side has gone
    time.sleep(0.5)  # the warm-up's last readings must not fall into the measurement
    stamps = np.empty(round(rate * seconds), dtype=np.int64)
    begin = time.monotonic()
    for i in range(len(stamps)):
        pause = begin + i / rate - time.monotonic()
        if pause > 0.0:
            time.sleep(pause)  # this is the clock of the source
        stamps[i] = sample()
    elapsed = time.monotonic() - begin
    pub.wait_for_all_acked(Duration(seconds=PATIENCE))  # the writer must outlive its last message
    sys.stdout.buffer.write(struct.pack('<d', elapsed) + stamps.tobytes())
    sys.stdout.flush()
    node.destroy_node()
    rclpy.try_shutdown()


def cpu_seconds(pid):
    """User and system time of a process so far, s."""
    fields = Path(f'/proc/{pid}/stat').read_text().rsplit(')', 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


class Receiver:
    """Readings as they come off the wire: arrival time and serialized message."""

    def __init__(self):
        import rclpy
        from rclpy.node import Node

        from msg_tools import NAMESPACE, topics
        from msg_tools.executor import NodeExecutor
        rclpy.init()
        self.arrivals, self.messages = [], []
        self.truth_arrivals, self.truth_messages = [], []
        self._node = Node('receiver', namespace=NAMESPACE, enable_rosout=False,
                          start_parameter_services=False)
        self._sub = self._node.create_subscription(
            topics.ABSOLUTE.message, topics.ABSOLUTE.name, self._on_reading,
            topics.ABSOLUTE.qos, raw=True)
        self._truth = self._node.create_subscription(
            topics.TRUTH_JOINTS.message, topics.TRUTH_JOINTS.name, self._on_truth,
            topics.TRUTH_JOINTS.qos, raw=True)
        self._executor = NodeExecutor()
        self._executor.add_node(self._node)

    def _on_reading(self, message):
        self.arrivals.append(time.time_ns())
        self.messages.append(message)

    def _on_truth(self, message):
        self.truth_arrivals.append(time.time_ns())
        self.truth_messages.append(message)

    def spin(self, done, patience):
        """Take messages until `done()`, which is asked ten times a second; False if it never is."""
        deadline = time.monotonic() + patience
        asked = 0.0
        while time.monotonic() < deadline:
            self._executor.spin_once(timeout_sec=0.05)
            if time.monotonic() - asked > 0.1:
                asked = time.monotonic()
                if done():
                    return True
        return False

    def readings(self):
        """Stamps (ns), arrivals (ns) and angles, shape (n, 2)."""
        return _joints(self.messages, self.arrivals)

    def truths(self):
        """The same of the true angles."""
        return _joints(self.truth_messages, self.truth_arrivals)

    def close(self):
        import rclpy
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.try_shutdown()


def _joints(messages, arrivals):
    from rclpy.serialization import deserialize_message

    from msg_tools import convert, topics
    rows = [convert.read_joints(deserialize_message(m, topics.ABSOLUTE.message)) for m in messages]
    return (np.array([row[0] for row in rows]), np.array(arrivals),
            np.array([row[1] for row in rows]))


def _percentiles(latency_ns):
    latency = latency_ns * 1e-6
    p50, p99, p999 = np.percentile(latency, [50, 99, 99.9])
    return {'p50': p50, 'p99': p99, 'p99.9': p999, 'max': latency.max()}


def run(rate, seconds, core, scenario, realtime, frames):
    """Measure; returns the figures as a dict."""
    from telescope_mount.dds import dds_environment
    from telescope_mount.graph import NODES, NodeSpec, every_frame
    from telescope_mount.processes import domain
    from telescope_mount.processes.node_processes import Processes
    with tempfile.TemporaryDirectory() as folder:
        lock = domain.claim()
        os.environ.update(dds_environment(lock.number), ROS_LOG_DIR=folder)
        processes = Processes(folder, lock.number)
        parameters = {'absolute_encoder': {'scenario': scenario}}
        if frames:
            parameters['absolute_encoder']['publishes'] = 'frames'
            parameters['frame_reader'] = every_frame()
        for name, values in parameters.items():
            processes.start(NodeSpec(name, NODES[name], values))
        pid = processes.running[name].pid
        # threads that it makes later inherit it
        for thread in os.listdir(f'/proc/{pid}/task'):
            os.sched_setaffinity(int(thread), {core})
        others = os.sched_getaffinity(0) - {core}
        if others:
            os.sched_setaffinity(0, others)
        source = subprocess.Popen(
            [sys.executable, __file__, '--publish', '--rate', str(rate), '--seconds',
             str(seconds)], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            env=processes.environment)
        if realtime:
            nodes = (node.pid for node in processes.running.values())
            for process in (*nodes, source.pid, 0):
                os.sched_setscheduler(process, os.SCHED_RR, os.sched_param(10))
        receiver = Receiver()
        try:
            if not receiver.spin(lambda: receiver.arrivals, PATIENCE):
                processes.check()
                raise RuntimeError('no reading arrived')
            before = cpu_seconds(pid)
            source.stdin.write(b'go\n')
            source.stdin.flush()
            expected = round(rate * seconds)
            last = [0, time.monotonic()]

            def finished():
                # all published, and nothing has come for two seconds
                processes.check()
                if len(receiver.arrivals) != last[0]:
                    last[:] = len(receiver.arrivals), time.monotonic()
                return last[0] >= expected and time.monotonic() - last[1] > 2.0

            receiver.spin(finished, 1.5 * seconds + 20.0)
            used = cpu_seconds(pid) - before
            out = source.communicate(timeout=PATIENCE)[0]
        finally:
            source.kill()
            receiver.close()
            processes.stop()
            lock.release()
    elapsed = struct.unpack('<d', out[:8])[0]
    published = np.frombuffer(out[8:], dtype=np.int64)
    stamps, arrivals, angles = receiver.readings()
    mine = np.isin(stamps, published)
    truth_stamps, truth_arrivals, _ = receiver.truths()
    alone = np.isin(truth_stamps, published)
    return {
        'seconds': seconds, 'published': len(published), 'rate_hz': len(published) / elapsed,
        'lost': int(len(published) - np.isin(published, stamps).sum()),
        'rejected': int(np.isnan(angles[mine]).sum()),
        'latency_ms': _percentiles((arrivals - stamps)[mine]),
        'truth_latency_ms': _percentiles((truth_arrivals - truth_stamps)[alone]),
        'node': name, 'cpu_ms_a_sample': 1e3 * used / len(published), 'core': core,
        'load_average': os.getloadavg()[0],
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seconds', type=float, default=60.0)
    parser.add_argument('--rate', type=float, default=1000.0, help='of each axis, Hz')
    parser.add_argument('--core', type=int, default=max(os.sched_getaffinity(0)))
    parser.add_argument('--realtime', action='store_true',
                        help='SCHED_RR for the three processes; needs the right to')
    parser.add_argument('--scenario', default='default')
    parser.add_argument('--frames', action='store_true',
                        help='measure frame_reader on the images of the simulator')
    parser.add_argument('--quick', action='store_true', help='5 seconds')
    parser.add_argument('--json', type=Path, metavar='FILE')
    parser.add_argument('--publish', action='store_true', help=argparse.SUPPRESS)
    args = parser.parse_args()
    seconds = 5.0 if args.quick else args.seconds
    if args.publish:
        return publish(args.rate, seconds)
    result = run(args.rate, seconds, args.core, args.scenario, args.realtime,
                 args.frames)
    if args.json:
        args.json.write_text(json.dumps(result, indent=2) + '\n')
    latency = result['latency_ms']
    print(f'{result["node"]}, 2 axes at {result["rate_hz"]:.1f} Hz for {seconds:g} s, node on core '
          f'{result["core"]} (load average of the machine {result["load_average"]:.1f})')
    print(f'  true angles published {result["published"]}, readings lost {result["lost"]} '
          f'(target 0), rejected {result["rejected"]}')
    print(f'  latency stamp to message: median {latency["p50"]:.2f} ms, p99 {latency["p99"]:.2f} '
          f'ms (target {TARGET_MS:g}), p99.9 {latency["p99.9"]:.2f} ms, largest '
          f'{latency["max"]:.2f} ms')
    truth = result['truth_latency_ms']
    print(f'  of it the machine, true angles alone: median {truth["p50"]:.2f} ms, p99 '
          f'{truth["p99"]:.2f} ms, largest {truth["max"]:.2f} ms')
    print(f'  CPU of the node {result["cpu_ms_a_sample"]:.2f} ms a sample of both axes')
    reached = result['lost'] == 0 and latency['p99'] <= TARGET_MS
    print('reached' if reached else 'MISSED')
    return 0


if __name__ == '__main__':
    sys.exit(main())
