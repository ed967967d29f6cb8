"""Node processes: start, watch, end."""

import contextlib
import ctypes
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import yaml

from msg_tools import NAMESPACE


def _die_with_parent():
    # a killed command line must not leave nodes behind (Linux: PR_SET_PDEATHSIG = 1)
    ctypes.CDLL(None, use_errno=True).prctl(1, signal.SIGTERM)


#: Without it a participant that starts between two announcements of another may wait for the
#: next one, and a writer that asks for acknowledgement for its next heartbeat: 3 s by default.
_DDS_PROFILE = """<?xml version="1.0" encoding="UTF-8" ?>
<dds><profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
<participant profile_name="quick_discovery" is_default_profile="true"><rtps><builtin>
<discovery_config><leaseAnnouncement><sec>0</sec><nanosec>200000000</nanosec></leaseAnnouncement>
</discovery_config></builtin></rtps></participant>
<data_writer profile_name="quick_repair" is_default_profile="true"><times><heartbeatPeriod>
<sec>0</sec><nanosec>100000000</nanosec></heartbeatPeriod></times></data_writer></profiles></dds>
"""


def dds_environment(folder, domain):
    """Environment variables with which a graph of one machine finds itself quickly.

    Parameters
    ----------
    folder : Path
        For the DDS profile.
    domain : int
        ROS domain.

    Returns
    -------
    dict of str to str
        What the user has set already is left as it is, but for the domain.
    """
    out = {'ROS_DOMAIN_ID': str(domain)}
    # opening the graph to the network is the user's explicit choice
    if 'ROS_AUTOMATIC_DISCOVERY_RANGE' not in os.environ:
        out['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    names = ('FASTDDS_DEFAULT_PROFILES_FILE', 'FASTRTPS_DEFAULT_PROFILES_FILE')
    if not any(name in os.environ for name in names):
        profile = Path(folder) / 'dds_profile.xml'
        profile.write_text(_DDS_PROFILE)
        out.update({name: str(profile.resolve()) for name in names})
    return out


class Processes:
    """The nodes of a graph, each a process of its own.

    Parameters
    ----------
    folder : Path
        For the output and the parameter file of each node.
    domain : int
        ROS domain.
    params_file : Path, optional
        A ROS parameter file of the user's, read after the graph's own values.
    """

    def __init__(self, folder, domain, params_file=None):
        self.folder = Path(folder)
        self.folder.mkdir(parents=True, exist_ok=True)
        self.params_file = params_file
        self.running = {}
        self.environment = dict(os.environ)
        self.environment.update(dds_environment(self.folder, domain),
                                ROS_LOG_DIR=str(self.folder), PYTHONUNBUFFERED='1')
        # eight small processes share the cores: threads of BLAS only get in each other's way
        self.environment.setdefault('OMP_NUM_THREADS', '1')
        self.environment.setdefault('OPENBLAS_NUM_THREADS', '1')

    def start(self, spec):
        """Start a `graph.NodeSpec`."""
        params = self.folder / f'{spec.name}.params.yaml'
        params.write_text(yaml.safe_dump({'/**': {'ros__parameters': spec.parameters}}))
        command = [sys.executable, '-m', spec.module, '--ros-args', '-r', f'__ns:={NAMESPACE}',
                   '--params-file', str(params)]
        if self.params_file:
            command += ['--params-file', str(self.params_file)]
        with open(self.folder / f'{spec.name}.log', 'ab') as log:
            self.running[spec.name] = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT,
                env=self.environment, start_new_session=True, preexec_fn=_die_with_parent)

    def last_words(self, name):
        """The last line that a node wrote, '' for none."""
        try:
            lines = (self.folder / f'{name}.log').read_text(errors='replace').split('\n')
        except OSError:
            return ''
        return next((line.strip() for line in reversed(lines) if line.strip()), '')

    def check(self):
        """Raise RuntimeError with a node's own words if one has ended."""
        for name, process in self.running.items():
            code = process.poll()
            if code is not None:
                words = self.last_words(name).removeprefix('error: ')
                raise RuntimeError(words or f'node {name} ended with code {code}')

    def stop(self, names=None, patience=20.0):
        """End nodes: Ctrl-C first, so that files are closed; the hard way for what stays.

        Returns
        -------
        dict of str to int
            Exit codes.
        """
        names = list(self.running if names is None else names)
        for sign, seconds in ((signal.SIGINT, patience), (signal.SIGTERM, 2.0),
                              (signal.SIGKILL, 5.0)):
            alive = [self.running[n] for n in names if self.running[n].poll() is None]
            for process in alive:
                process.send_signal(sign)
            deadline = time.monotonic() + seconds
            for process in alive:
                with contextlib.suppress(subprocess.TimeoutExpired):
                    process.wait(max(0.01, deadline - time.monotonic()))
        return {name: self.running.pop(name).returncode for name in names}
