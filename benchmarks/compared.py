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

"""Speed of our code and of what a user would run instead: rows for `all.py`, one function per part.

Each takes `full` and returns a list of `race.Row`. A peer that is not installed leaves its place
empty; the extras `bench` and `test` bring them.
"""

import json
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path

import axes_speed
import fit_vs_katpoint
import frames_speed
import load
import numpy as np
import places_speed
from earlier_commit import BESIDE, LEAST, earlier_tree, run_options
from race import Row, race

from msg_tools.units import ARCSEC
from pointing_model.model import PointingModel
from pointing_model.pointing_terms import PHYSICAL
from pointing_model.sky.refraction import Weather
from pointing_model.sky.site import DEFAULT_SITE


def raced(part, size, wanted, ours, peers, rounds=5):
    """Rows of `ours`, a dict of name to call, each beside the peers that it is `wanted` beside."""
    best = race({**ours, **{name: call for name, call in peers.items() if call}}, rounds)
    return [Row(part, what, size, best[what], peer, best.get(peer), least)
            for what, of_peers in wanted.items() for peer, least in of_peers.items()]


# --- numerics -------------------------------------------------------------------------------------


def fits(full):
    """Seven terms of a run, beside katpoint and scipy's robust fit."""
    rows = fit_vs_katpoint.rows([n for n in fit_vs_katpoint.SIZES if full or n < 1e6],
                                names=(fit_vs_katpoint.DEFAULT,))
    from scipy.optimize import least_squares

    from calibration.analysis.term_fit import fit_terms
    run = fit_vs_katpoint.make_run(1000, 2)

    def soft(p):
        x, y = PointingModel(dict(zip(PHYSICAL, p))).residuals(run)
        return np.concatenate((x, y)) / ARCSEC
    return rows + raced('fit', '1000', {'robust fit': {'scipy least_squares, soft L1': None}}, {
        'robust fit': lambda: fit_terms(run)}, {
        'scipy least_squares, soft L1': lambda: least_squares(
            soft, np.zeros(7), loss='soft_l1', x_scale=ARCSEC)})


def angles(full):
    """Directions to encoder angles and back, beside katpoint."""
    return axes_speed.rows(5 if full else 3)


def sky(full):
    """Places of stars and of a satellite, beside katpoint, astropy, Skyfield."""
    return places_speed.rows(5 if full else 2) + _satellite(1000)


def _satellite(count):
    from pointing_model.sky.elements import GPS_26690, parse_elements
    from pointing_model.sky.satellite_place import satellite_place
    satellite = parse_elements(GPS_26690)
    start = 1.3799e9
    times = np.linspace(start, start + 7200.0, count)
    theirs = None
    if find_spec('skyfield'):
        from skyfield import api
        scale = api.load.timescale(builtin=True)
        body = api.EarthSatellite(*GPS_26690, ts=scale) - api.wgs84.latlon(34.0, 109.0, 500.0)
        when = scale.tt_jd(times / 86400.0 + 2440587.5 + 67.2 / 86400.0)

        def theirs():
            body.at(when).altaz()
    return raced('sky', f'{count}', {'a satellite, all its epochs': {'Skyfield': None}}, {
        'a satellite, all its epochs': lambda: satellite_place(
            satellite, times, DEFAULT_SITE, Weather(pressure_hpa=0.0))}, {'Skyfield': theirs})


def frames(full):
    """Images of the absolute encoder, beside the paper's fit."""
    return frames_speed.rows(20 if full else 9)


# --- logs and files -------------------------------------------------------------------------------


def logs(full):
    """Logs of joint states: written, read, decoded."""
    from mcap.reader import make_reader
    from mcap.writer import Writer

    from msg_tools import topics
    from msg_tools.bag import BagReader, BagWriter
    n = 100_000 if full else 20_000
    rng = np.random.default_rng(1)
    topic = topics.OFFSET
    data = [b'\0\1\0\0' + bytes(8) + b'\1\0\0\0' + bytes(4) + rng.bytes(24) for _ in range(1000)]
    folder = Path(tempfile.mkdtemp())
    count = iter(range(10**6))

    def ours():
        with BagWriter(folder / f'ours{next(count)}') as out:
            out.add_topic('/t', topic.type, [topic.qos])
            for i in range(n):
                out.write('/t', data[i % 1000], i, i, i)

    def theirs():
        with open(folder / f'theirs{next(count)}.mcap', 'wb') as stream:
            writer = Writer(stream)
            writer.start('ros2', 'x')
            channel = writer.register_channel('/t', 'cdr', writer.register_schema(
                topic.type, 'ros2msg', definition))
            for i in range(n):
                writer.add_message(channel, i, data[i % 1000], i, i)
            writer.finish()
    with BagWriter(folder / 'read') as out:
        out.add_topic('/t', topic.type, [topic.qos])
        for i in range(n):
            out.write('/t', data[i % 1000], i * 1000, i * 1000, i)
    file = next((folder / 'read').glob('*.mcap'))
    with open(file, 'rb') as stream:
        definition = make_reader(stream).get_summary().schemas[1].data

    def read_ours():
        for _ in BagReader(folder / 'read').messages():
            pass

    def read_theirs():
        with open(file, 'rb') as stream:
            for _ in make_reader(stream).iter_messages():
                pass

    def decode_ours():
        for _ in BagReader(folder / 'read').messages(decode=True):
            pass

    def decode_theirs():
        from mcap_ros2.reader import read_ros2_messages
        for _ in read_ros2_messages(str(file)):
            pass

    def decode_rosbags():
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
        with AnyReader([folder / 'read'], default_typestore=get_typestore(
                Stores.ROS2_JAZZY)) as reader:
            for connection, _, raw in reader.messages():
                reader.deserialize(raw, connection.msgtype)
    rows = []
    for what, mine, peers in (
            ('written', ours, {'mcap': theirs}), ('read', read_ours, {'mcap': read_theirs}),
            ('decoded', decode_ours, {
                'mcap-ros2-support': decode_theirs,
                'rosbags': decode_rosbags if find_spec('rosbags') else None})):
        rows += raced('log', f'{n} messages', {what: dict.fromkeys(peers)}, {what: mine}, peers, 3)
    shutil.rmtree(folder)
    return rows


# --- nights ---------------------------------------------------------------------------------------


def _processor_time(command, tree):
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([sys.executable, '-m', 'telescope_mount', command, '--out',
                        f'{folder}/night'], check=True, stdout=subprocess.DEVNULL,
                       stderr=subprocess.DEVNULL, **run_options(tree))
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return (after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
            time.perf_counter() - begin)


def nights(full):
    """Whole nights from the command line: processor time of all processes, and wall time."""
    here, rows = Path(__file__).parent.parent, []
    with earlier_tree() as before:
        for what, command in (('a night of 30 stars', 'night'),
                              *([('11 nights', 'experiment')] if full else [])):
            best = np.full((2, 2), np.inf)
            for _ in range(3):
                for one, tree in enumerate((here, before)):
                    best[one] = np.minimum(best[one], _processor_time(command, tree))
            rows += [Row('graph', what, size, ours, BESIDE, theirs, LEAST)
                     for size, ours, theirs in zip(('processor time', 'wall time'), *best.tolist())]
    return rows


def months(full):
    """200 nights in one graph: what grows; nothing in a short run."""
    if not full:
        return []
    with tempfile.TemporaryDirectory() as folder:
        kept = Path(folder) / 'measured.json'
        subprocess.run([sys.executable, Path(__file__).with_name('long_run.py'), '--full',
                        '--keep', kept], check=True, stdout=subprocess.DEVNULL)
        told = json.loads(kept.read_text())
    first, last = told['nights'][4], told['nights'][-1]
    growth = {name: 100.0 * (last[name]['rss'] / first[name]['rss'] - 1.0) for name in last}
    worst = max(growth, key=growth.get)
    more = {name: sum(last[one][name] - first[one][name] for one in last)
            for name in ('files', 'threads')}
    size = f'{len(told["nights"])} nights'
    return [
        Row('months', 'growth of memory since night 5', size, growth[worst], 'limit 2 %', 2.0, 1.0,
            f'{worst}; more files {more["files"]}, threads {more["threads"]}', '%'),
        Row('months', 'a night, the last', size, float(np.median(told['seconds'][-5:])),
            'limit: the fifth', float(np.median(told['seconds'][2:7])))]


#: in the order of the table
PARTS = {'fit': fits, 'model': angles, 'sky': sky, 'encoder': frames, 'log': logs, 'graph': nights,
         'load': load.rows, 'months': months}
