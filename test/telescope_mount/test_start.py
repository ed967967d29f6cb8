"""How an executable of `ros2 run` begins."""

import signal
import subprocess
import sys

import pytest


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_node_that_is_told_to_end_while_it_imports_does_so_without_a_word(number):
    # as a script starts it in the background: with SIGINT ignored
    done = subprocess.run(
        [sys.executable, '-c', 'import os, telescope_mount.start; '
         f'os.kill(os.getpid(), {int(number)}); print("went on")'], capture_output=True,
        text=True, check=False, preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN))
    assert (done.returncode, done.stdout, done.stderr) == (0, '', '')
