"""What is ours beside what a user would run instead: rows for `all.py`, a function a part.

Each takes `full` and returns a list of `race.Row`. A peer that is not installed leaves its place
empty; the extras `bench` and `test` bring them.
"""

import resource
import shutil
import subprocess
import sys
import tempfile
import time
import warnings
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from fit_vs_katpoint import P_TERMS, TRUTH, make_run
from race import Row, race

from msg_tools.units import ARCSEC, DEG
from pointing_model.model import PointingModel
from pointing_model.sky import Site, Weather, icrs_to_observed
from pointing_model.terms import PHYSICAL, stacked_design

SITE = Site(34.0 * DEG, 109.0 * DEG, 500.0)
START = 1.7e9
#: of the linear algebra that fits a line: what no fit can beat
LIMIT = 'numpy, normal equations'


def have(*modules):
    """Whether all are installed."""
    return all(find_spec(name) is not None for name in modules)


def raced(part, size, wanted, ours, peers, rounds=5):
    """Rows of `ours`, a dict of name to call, each beside the peers that it is `wanted` beside."""
    best = race({**ours, **{name: call for name, call in peers.items() if call}}, rounds)
    return [Row(part, what, size, best[what], peer, best.get(peer), least)
            for what, of_peers in wanted.items() for peer, least in of_peers.items()]


# --- fits -----------------------------------------------------------------------------------------


def fits(full):
    """Seven terms of a run."""
    from calibration.fit import fit_terms
    rows = []
    least = {30: 0.4, 1000: 1.2, 30_000: 2.0, 1_000_000: 4.0}
    for n in (30, 1000, 30_000, *([1_000_000] if full else [])):
        run = make_run(n, 1)
        az, el = run['az'], run['el']
        d_az, d_el = run['az_enc'] - az, run['el_enc'] - el
        peers = {'katpoint': None, LIMIT: None}
        if have('katpoint'):
            import katpoint
            theirs = katpoint.PointingModel()
            enabled = [P_TERMS[name][0] for name in PHYSICAL]

            def katpoint_fit(theirs=theirs, enabled=enabled, at=(az, el, d_az, d_el)):
                theirs.set()
                theirs.fit(*at, enabled_params=enabled, keep_disabled_params=True)
            peers['katpoint'] = katpoint_fit

        def normal(run=run):
            columns = stacked_design(PHYSICAL, run['az'], run['el'])
            np.linalg.solve(columns @ columns.T, columns @ np.concatenate(run.offsets()))
        peers[LIMIT] = normal
        default, plain = 'default fit: rotations, robust, covariance', 'plain weighted fit'
        rows += raced('fit', f'{n} rows', {
            default: {'katpoint': least[n]}, plain: {LIMIT: 1 / 1.5 if n == 1_000_000 else None}}, {
            default: lambda run=run: fit_terms(run),
            plain: lambda run=run: fit_terms(run, robust=False, geometry='first_order')}, peers)
    run = make_run(1000, 2)
    from scipy.optimize import least_squares

    def soft(p):
        x, y = PointingModel(dict(zip(PHYSICAL, p))).residuals(run)
        return np.concatenate((x, y)) / ARCSEC
    rows += raced('fit', '1000 rows', {'robust fit': {'scipy least_squares, soft L1': None}}, {
        'robust fit': lambda: fit_terms(run)}, {
        'scipy least_squares, soft L1': lambda: least_squares(
            soft, np.zeros(7), loss='soft_l1', x_scale=ARCSEC)})
    return rows


# --- model ----------------------------------------------------------------------------------------


def angles(full):
    """Directions to encoder angles and back."""
    n = 1_000_000 if full else 100_000
    run, model = make_run(n, 3), PointingModel(TRUTH)
    az, el = run['az'], run['el']
    there = model.sky_to_encoder(az, el)
    peers = {'katpoint': None, 'katpoint, back': None}
    if have('katpoint'):
        import katpoint
        theirs = katpoint.PointingModel()
        theirs.fromlist([0.0] * 8)
        for name, value in TRUTH.items():
            number, sign = P_TERMS[name]
            theirs[f'P{number}'] = sign * value
        peers = {'katpoint': lambda: theirs.apply(az, el),
                 'katpoint, back': lambda: theirs.reverse(*there)}
    return raced('model', f'{n} directions', {
        'to the encoder': {'katpoint': None}, 'to the sky': {'katpoint, back': None}}, {
        'to the encoder': lambda: model.sky_to_encoder(az, el),
        'to the sky': lambda: model.encoder_to_sky(*there)}, peers)


# --- sky ------------------------------------------------------------------------------------------


def _katpoint_place(times):
    import katpoint
    antenna = katpoint.Antenna('A, 34:00:00.0, 109:00:00.0, 500.0, 10.0')
    target = katpoint.Target('star, radec, 4:00:00, 20:00:00')
    return lambda: target.azel(times, antenna)


def _astropy_place(times, interpolated=None):
    import astropy.units as u
    from astropy.coordinates import AltAz, EarthLocation, SkyCoord
    from astropy.coordinates.erfa_astrom import ErfaAstromInterpolator, erfa_astrom
    from astropy.time import Time
    from astropy.utils import iers
    iers.conf.auto_download = False
    place = EarthLocation.from_geodetic(109.0 * u.deg, 34.0 * u.deg, 500.0 * u.m)
    star = SkyCoord(60.0 * u.deg, 20.0 * u.deg)
    when = Time(times, format='unix')

    def call():
        frame = AltAz(obstime=when, location=place, pressure=950 * u.hPa, temperature=10 * u.deg_C,
                      relative_humidity=0.5, obswl=0.55 * u.micron)
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')
            if interpolated:
                with erfa_astrom.set(ErfaAstromInterpolator(interpolated * u.s)):
                    return star.transform_to(frame)
            return star.transform_to(frame)
    return call


def _skyfield_star(times):
    from skyfield import api
    from skyfield_data import get_skyfield_data_path
    scale = api.load.timescale(builtin=True)
    planets = api.Loader(get_skyfield_data_path(), verbose=False)('de421.bsp')
    place = planets['earth'] + api.wgs84.latlon(34.0, 109.0, 500.0)
    star = api.Star(ra_hours=4.0, dec_degrees=20.0)
    when = scale.tt_jd(times / 86400.0 + 2440587.5 + 69.2 / 86400.0)
    return lambda: place.at(when).observe(star).apparent().altaz(10.0, 950.0)


def sky(full):
    """Places of stars and satellites."""
    weather = Weather(950.0, 10.0, 0.5, 0.55)
    ra, dec = 60.0 * DEG, 20.0 * DEG
    many = np.linspace(START, START + 86400.0, 10_000)
    rows = raced('sky', '10000 epochs in a day', {'one star': {
        'katpoint': None, 'astropy': None, 'astropy, interpolated': None, 'Skyfield': None}}, {
        'one star': lambda: icrs_to_observed(ra, dec, many, SITE, weather)}, {
        'katpoint': _katpoint_place(many) if have('katpoint') else None,
        'astropy': _astropy_place(many) if have('astropy') and full else None,
        'astropy, interpolated': _astropy_place(many, 300.0) if have('astropy') else None,
        'Skyfield': (_skyfield_star(many) if have('skyfield', 'skyfield_data') and full
                     else None)}, 5 if full else 2)
    count = iter(range(10**9))

    def first():  # of a night: another day each time
        icrs_to_observed(ra, dec, START + 86400.0 * (1 + next(count) % 3000), SITE, weather)

    def further():  # of the same night: a quarter of a second on
        icrs_to_observed(ra, dec, START + 0.25 * next(count), SITE, weather)
    rows += raced('sky', 'one epoch', {
        'first place of a night': {'limit 110 us': 1.0, 'katpoint': None, 'astropy': None},
        'each further one': {'limit 25 us': 1.0}}, {
        'first place of a night': first, 'each further one': further}, {
        'katpoint': _katpoint_place(START) if have('katpoint') else None,
        'astropy': _astropy_place(START) if have('astropy') else None})
    limits = {'limit 110 us': 110e-6, 'limit 25 us': 25e-6}
    rows = [row if row.peer not in limits else Row(
        row.part, row.what, row.size, row.ours, row.peer, limits[row.peer], row.least)
        for row in rows]
    return rows + _satellite(1000)


def _satellite(count):
    from pointing_model.satellite import satellite_place
    from pointing_model.satellite_elements import GPS_26690, parse_elements
    satellite = parse_elements(GPS_26690)
    start = 1.3799e9
    times = np.linspace(start, start + 7200.0, count)
    theirs = None
    if have('skyfield'):
        from skyfield import api
        scale = api.load.timescale(builtin=True)
        body = api.EarthSatellite(*GPS_26690, ts=scale) - api.wgs84.latlon(34.0, 109.0, 500.0)
        when = scale.tt_jd(times / 86400.0 + 2440587.5 + 67.2 / 86400.0)

        def theirs():
            body.at(when).altaz()
    return raced('sky', f'{count} epochs', {'a satellite': {'Skyfield': None}}, {
        'a satellite': lambda: satellite_place(satellite, times, SITE, Weather(pressure_hpa=0.0))},
        {'Skyfield': theirs})


# --- encoders -------------------------------------------------------------------------------------


def frames(full):
    """Images of the absolute encoder, clean and dirty, in batches of 256."""
    from absolute_encoder import SCALES, conditions
    from encoder_frames import Source

    from encoder_reading.paper_reader import PaperReader
    from encoder_reading.template_reader import TemplateReader
    rows, n, pitch = [], 256, min(SCALES)
    for what, (params, blobs) in conditions(pitch).items():
        batch = Source(params, 1, blobs).random(n)[1]
        ours, theirs = TemplateReader(params.design), PaperReader(params.design, cycle='centres')
        best = race({'ours': partial(ours.read, batch), 'paper': partial(theirs.read, batch)})
        rows.append(Row('encoder', what, f'a frame of {n}', best['ours'] / n,
                        "the paper's sine fit", best['paper'] / n))
        if what != 'clean':
            rows.append(Row('encoder', what, f'a frame of {n}', best['ours'] / n, 'limit 15 us',
                            15e-6, 1.0))
    return rows


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
            ('decoded', decode_ours, {'mcap-ros2-support': decode_theirs,
                                      'rosbags': decode_rosbags if have('rosbags') else None})):
        rows += raced('log', f'{n} messages', {what: dict.fromkeys(peers)}, {what: mine}, peers, 3)
    shutil.rmtree(folder)
    return rows


# --- nights ---------------------------------------------------------------------------------------


def _processor_time(*command):
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return (after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
            time.perf_counter() - begin)


def nights(full):
    """Whole nights from the command line: processor time of all processes, and wall time."""
    rows = []
    for what, command, cpu, wall in (
            ('a night of 30 stars', 'night', 7.0, 4.0),
            *([('11 nights', 'experiment', 18.0, None)] if full else [])):
        best = [np.inf, np.inf]
        for _ in range(3 if full else 2):
            with tempfile.TemporaryDirectory() as folder:
                took = _processor_time(sys.executable, '-m', 'telescope_mount', command, '--out',
                                       f'{folder}/night')
            best = np.minimum(best, took)
        rows.append(Row('graph', what, 'processor time', float(best[0]), f'limit {cpu:g} s', cpu,
                        1.0))
        if wall:
            rows.append(Row('graph', what, 'wall time', float(best[1]), f'limit {wall:g} s', wall,
                            1.0, 'on two free cores'))
    return rows


#: in the order of the table
PARTS = {'fit': fits, 'model': angles, 'sky': sky, 'encoder': frames, 'log': logs, 'graph': nights}
