"""Every derived number of a log, computed again from what it was derived from."""

import copy
import json
import struct
from collections import Counter, deque
from functools import partial
from pathlib import Path

import numpy as np

from calibration.harmonic_fit import choice_of, choice_of_report
from calibration.nights import NightSeries
from calibration.session import CalibrationSession
from calibration.witnesses import encoder_diagnostics, homings_from_diagnostics, homings_of
from msg_tools.bag import BagReader
from msg_tools.bag.provenance import parameters_of
from msg_tools.convert import from_stamp, read_joints
from msg_tools.homing import cloud_to_homing
from msg_tools.units import DEG
from pointing_model.effects import declared_graduation
from pointing_model.model import PointingModel
from pointing_model.mounts import is_beyond
from pointing_model.observing.pairing import (
    RATE_OVER,
    centred,
    centred_second,
    interpolate,
)
from pointing_model.run_messages import cloud_to_run
from pointing_model.zero_message import joints_to_zero

#: readings of an encoder that are kept until the observation of their time comes
READINGS = 50_000
#: ns that an observation waits for readings after it, where no more of them are kept
PATIENCE = 60 * 10**9
#: what the encoders said of their marks around a fit, so many are tried for its report
_STATES = 3

_RAW = {'incremental/joint_states': 'enc', 'absolute/joint_states': 'abs'}


def verify_log(bag, *, reference=None, seed=None):
    """Compute zeros, models, reports and diagnoses of a log anew, and the observations too.

    Encoder readings and miss distances give the observations; the observations give the rest, in
    a calibration of their own, without a ROS graph. A number is right if it is the same to the
    bit.

    Parameters
    ----------
    bag : str or Path
        Log of a night.
    reference : str or Path, optional
        The reference model that the night had; by default what the log says of it.
    seed : int, optional
        Of the choice of held-out stars; by default that of the log, or 1.

    Returns
    -------
    dict
        ``checked`` (kind -> count), ``differences`` and ``unchecked``, a line each.

    Raises
    ------
    ValueError
        Nothing derived is in the log, it holds the simulator's truth, or the reference is gone.
    OSError
        It may not be read.
    """
    log = BagReader(bag)
    if log.has_truth:
        raise ValueError(f'{bag} holds the truth of the simulator; verify the log beside it')
    name = next((t.name for t in log.topics if t.name.endswith('/observation') and t.count), None)
    if name is None:
        raise ValueError(f'{bag} has no observation in it; it is no log of a night')
    check = _Check()
    prefix = name[:-len('observation')]
    rows = _read(log, prefix, check)
    parameters = parameters_of(log.metadata, f'{prefix}calibration') or {}
    if not parameters:
        check.unchecked.append('the log does not tell the parameters of the calibration: its '
                               'defaults are taken (see --seed, --reference)')
    if parameters.get('graduation'):
        for part in (*rows.observations.values(), *rows.tables.values()):
            part.meta['graduation'] = declared_graduation(parameters['graduation'])
    session = _session(log, parameters, reference, seed, rows)
    if isinstance(session, NightSeries):
        for _, homings in rows.homings:
            session.hear(homings(0))
    _calibrate(rows, session, parameters, check)
    if not check.checked:
        raise ValueError(f'{bag} has nothing derived in it that could be verified')
    check.unchecked += log.problems
    return {'checked': dict(check.checked), 'differences': check.differences,
            'unchecked': check.unchecked}


class _Check:
    """Counts what was compared, and keeps a line for what differs."""

    def __init__(self):
        self.checked = Counter()
        self.differences = []
        self.unchecked = []

    def compare(self, kind, logged, computed, where):
        """Compare texts, or numbers bit by bit."""
        self.checked[kind] += 1
        if isinstance(logged, str):
            same = logged == computed
        else:
            logged, computed = (np.asarray(v, dtype=float) for v in (logged, computed))
            same = logged.shape == computed.shape and np.array_equal(
                logged, computed, equal_nan=True)
        if not same:
            self.differences.append(f'{kind} of {where}: {_difference(logged, computed)}')


def _difference(logged, computed):
    if isinstance(logged, str):
        try:
            return _first_difference(json.loads(logged), json.loads(computed or 'null'))
        except ValueError:
            return 'another text'
    return f'logged {logged.tolist()}, computed {computed.tolist()}'


def _first_difference(a, b, path=''):
    if isinstance(a, dict) and isinstance(b, dict):
        for key in [*a, *(k for k in b if k not in a)]:
            if key not in a or key not in b:
                return f'{path}{key} is only in one of them'
            if a[key] != b[key]:
                return _first_difference(a[key], b[key], f'{path}{key}.')
    if isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        for number, (one, other) in enumerate(zip(a, b)):
            if one != other:
                return _first_difference(one, other, f'{path}{number}.')
    return f'{path.rstrip(".") or "document"}: logged {str(a)[:60]}, computed {str(b)[:60]}'


# --- the log, read once --------------------------------------------------------------------------


class _Rows:
    """What of a log the calibration heard and said."""

    def __init__(self):
        self.observations = {}  # stamp -> PointingRun
        self.tables = {}  # stamp -> PointingRun
        self.said = {name: [] for name in ('zero', 'model', 'calibration/report', 'diagnosis')}
        #: (log time, callable that gives the homings of a run); of old logs from diagnostics
        self.homings, self.diagnosed = [], []


def _read(log, prefix, check):
    """One pass; observations are compared with their readings on the way."""
    rows, pairing = _Rows(), _Pairing(log, check)
    names = (*rows.said, *_RAW, 'observation', 'observations', 'offset', 'camera/miss_distance',
             'incremental/homing')
    for message in log.messages([*(prefix + name for name in names), '/diagnostics']):
        name = message.topic.removeprefix(prefix)
        if name in _RAW:
            pairing.reading(_RAW[name], message)
            continue
        data = log.decode(message)
        if data is None:
            continue
        if name in rows.said:
            rows.said[name].append((message.log_time, data))
        elif name == 'observation':
            stamp = from_stamp(data.header.stamp)
            rows.observations[stamp] = cloud_to_run(data)
            pairing.observation(stamp, rows.observations[stamp])
        elif name == 'observations':
            if data.width:
                rows.tables[from_stamp(data.header.stamp)] = cloud_to_run(data)
        elif name == 'offset':
            pairing.offsets[from_stamp(data.header.stamp)] = data.vector.x, data.vector.y
        elif name == 'camera/miss_distance':
            pairing.frames[from_stamp(data.header.stamp)] = data.vector.x, data.vector.y
        elif name == 'incremental/homing':
            rows.homings.append((message.log_time, partial(homings_of, cloud_to_homing(data))))
        else:
            rows.diagnosed += [(message.log_time, partial(homings_from_diagnostics, values))
                               for values in encoder_diagnostics(data, prefix)]
    pairing.finish(rows.observations)
    return rows


class _Pairing:
    """Observations from readings and exposures, as the observer makes them."""

    def __init__(self, log, check):
        self._log, self._check = log, check
        self._readings = {encoder: deque(maxlen=READINGS) for encoder in _RAW.values()}
        self.frames = {}
        self._waiting = deque()
        self.offsets = {}

    def reading(self, encoder, message):
        """Keep a reading; decoded only if an observation falls beside it."""
        order = '<' if message.data[1:2] == b'\1' else '>'
        if len(message.data) < 12:
            return
        sec, nanosec = struct.unpack_from(f'{order}iI', message.data, 4)
        self._readings[encoder].append((sec * 1_000_000_000 + nanosec, message))
        if self._waiting:
            self._go_on()

    def observation(self, stamp, run):
        """Compare as soon as there are readings on both sides."""
        self._waiting.append((stamp, run))
        self._go_on()

    def _go_on(self, end=False):
        while self._waiting:
            stamp, run = self._waiting[0]
            newest = [r[-1][0] for r in self._readings.values() if r]
            ready = stamp in self.frames and len(newest) == len(_RAW) and min(newest) > stamp
            # nodes are not logged in the order in which they heard each other: on a busy machine
            # one's messages come in a bunch, minutes of a simulated night at once
            full = any(len(r) == READINGS for r in self._readings.values())
            if not (ready or end or (full and max(newest) >= stamp + PATIENCE)):
                return
            self._waiting.popleft()
            self._compare(stamp, run)

    def finish(self, observations):
        """Compare what still waits, and the offsets of all `observations`."""
        self._go_on(end=True)
        for stamp, run in observations.items():
            if stamp in self.offsets:
                x, y = run.offsets()
                self._check.compare('offset', self.offsets[stamp], [x[0], y[0]], _at(stamp))

    def _compare(self, stamp, run):
        miss = self.frames.get(stamp)
        found = {}
        beyond = not run.mount.altaz and bool(is_beyond(run['el'][0]))
        for encoder, readings in self._readings.items():
            angles = self._around(readings, stamp)
            if miss is None or angles is None:
                continue
            stamps, readings = angles
            angles = stamps, [run.mount.on_travel(*reading) for reading in readings]
            angle, rate = interpolate(*angles, stamp, RATE_OVER)
            if encoder == 'enc':
                read, found[encoder] = angle, np.array(centred(*angle, *miss, beyond))
                # of logs from before it was taken over a second
                rates = rate, interpolate(*angles, stamp)[1]
            elif 'enc' in found:
                found[encoder] = centred_second(angle, read, miss, beyond)
        if 'enc' not in found:
            self._check.unchecked.append(
                f'observation of {_at(stamp)}: its exposure or its readings are not in the log')
            return
        for encoder, angle in found.items():
            if f'az_{encoder}' in run:
                logged = [run[f'{axis}_{encoder}'][0] for axis in ('az', 'el')]
                self._check.compare(f'{encoder} of observation', logged, angle, _at(stamp))
        if 'az_rate' in run:
            logged = [run['az_rate'][0], run['el_rate'][0]]
            rate = rates[1] if np.array_equal(logged, rates[1]) else rates[0]
            self._check.compare('rate of observation', logged, rate, _at(stamp))

    def _around(self, readings, stamp):
        """Stamps and angles of the readings from a second before `stamp` to the next, or None."""
        high, before = None, []
        for when, message in reversed(readings):
            if when >= stamp:
                high = when, message
                continue
            before.append((when, message))
            if when < stamp - RATE_OVER:
                break
        if not before or high is None:
            return None
        beside = [*before[::-1], high]
        decoded = [self._log.decode(message) for _, message in beside]
        if None in decoded:
            return None
        return [when for when, _ in beside], [read_joints(data)[1] for data in decoded]


def _at(stamp):
    return f'{stamp // 10**9}.{stamp % 10**9:09d} s'


# --- the calibration, once more ------------------------------------------------------------------


def _session(log, parameters, reference, seed, rows):
    seed = seed if seed is not None else parameters.get('split_seed', 1)
    model = None
    if reference is not None:
        model = PointingModel.load(reference)
    elif parameters.get('model_file'):
        if any(a.name == 'reference_model.json' for a in log.attachments):
            model = PointingModel.from_json(log.read_attachment('reference_model.json').decode())
        elif Path(parameters['model_file']).is_file():
            model = PointingModel.load(parameters['model_file'])
        else:
            raise ValueError(f'the night had the reference model {parameters["model_file"]}, '
                             'which is not there: give it with --reference')
    age = parameters.get('reference_age', 0)
    harmonics = choice_of(parameters)
    reports = rows.said['calibration/report']
    if not parameters and reports:
        harmonics = choice_of_report(_document(reports[-1][1].data))
    return (NightSeries(age, model, seed, harmonics) if age
            else CalibrationSession(model, seed, harmonics=harmonics))


def _calibrate(rows, session, parameters, check):
    """Feed the observations one by one, and repeat what was asked for after each."""
    zeros, models = {}, {}
    for _, data in rows.said['zero']:
        zeros.setdefault(from_stamp(data.header.stamp), []).append(data)
    for log_time, data in rows.said['model']:
        try:
            stamp = json.loads(data.data)['provenance'].get('last_stamp_ns', 0)
        except (ValueError, KeyError, AttributeError, TypeError):
            check.unchecked.append('a model that is no document of ours')
            continue
        models.setdefault(stamp, []).append((log_time, data.data))
    replay = _Replay(session, rows, parameters, check)
    for stamp in sorted({*rows.observations, *zeros, *models, *rows.tables}):
        if stamp in rows.observations:
            replay.session.add(rows.observations[stamp], stamp)
        elif stamp in rows.tables:
            replay.session.take_table(rows.tables[stamp], stamp)
        if stamp in zeros or stamp in models:
            replay.at(stamp, zeros.get(stamp, []), models.get(stamp, []))


class _Replay:
    """What the calibration was asked for at one stamp, done again and compared."""

    def __init__(self, session, rows, parameters, check):
        self.session, self._rows, self._check = session, rows, check
        self._parameters = parameters
        self._reports, self._diagnoses = (
            deque(data.data for _, data in rows.said[name])
            for name in ('calibration/report', 'diagnosis'))

    def at(self, stamp, zeros, models):
        """Zeros by Polaris first, then fits, then diagnoses, each with its zero."""
        if self.session.last_stamp != stamp:
            self._check.unchecked.append(
                f'what was derived at {_at(stamp)}: its observation is not in the log')
            return
        made = models[sum(self._is_dated_reference(text) for _, text in models):]
        calibrated = max(0, len(zeros) - len(made))
        computed = []
        if calibrated:
            try:
                run, zero = self.session.calibrate_zero()
            except ValueError as error:
                self._check.differences.append(f'zero of {_at(stamp)}: {error}')
                return
            computed += [(zero, True)] * calibrated
        for log_time, text in made:
            told = json.loads(text)['provenance']
            if 'refit' in told:
                model = self._fit(stamp, log_time)
            elif 'judged' in told:
                model = self._diagnose(stamp, again=True)
            elif 'verdict' in told:
                model = self._diagnose(stamp)
            else:
                model = self._fit(stamp, log_time)
            self._check.compare('model', text, model.to_json(), _at(stamp))
            self.session.in_force = model
            computed.append((self.session.zeros_in_force.newest, False))
        for data, (zero, by_polaris) in zip(zeros, computed):
            _, logged = joints_to_zero(data)
            self._check.compare('zero', logged.angles, zero.angles, _at(stamp))
            if by_polaris:
                self._check.compare('sigma of the zero', logged.sigma, zero.sigma, _at(stamp))

    def _is_dated_reference(self, text):
        """Whether a model is the reference, published with the zero that is relative to it."""
        if not self._parameters.get('reference_age') or self.session.reference is None:
            return False
        document = json.loads(text)
        own = json.loads(self.session.reference.to_json())
        for one in (document, own):
            one['provenance'] = {k: v for k, v in one['provenance'].items()
                                 if k != 'last_stamp_ns'}
        return document == own

    def _fit(self, stamp, log_time):
        logged = self._report(stamp)
        before, first = self.session, None
        for homings in self._homings(log_time):
            session = copy.deepcopy(before)  # a fit is judged against the one before it
            model, report = session.fit(homings)
            tried = session, model, json.dumps(report)
            first = first or tried
            if logged in (None, tried[-1]):
                break
        else:
            tried = first
        self.session, model, report = tried
        if logged is None:
            self._check.unchecked.append(f'report of {_at(stamp)}: it is not in the log')
        else:
            self._check.compare('report', logged, report, _at(stamp))
        return model

    def _homings(self, log_time):
        """What the encoders said of their marks as of `log_time`, then beside it, then nothing."""
        states = self._rows.homings or self._rows.diagnosed
        newest = sum(when <= log_time for when, _ in states) - 1
        near = sorted(range(len(states)), key=lambda i: (abs(i - newest), i))
        for i in near[:_STATES]:
            yield [h for h in states[i][1](self.session.newest) if h.homed]
        if not states:
            yield []
        yield None

    def _diagnose(self, stamp, again=False):
        """The model of a diagnosis, or (`again`) of the judgement by blind stars after it."""
        logged = self._diagnoses.popleft() if self._diagnoses else '{}'
        document = json.loads(logged)
        text = self._parameters.get('site', '')
        degrees = ([float(part) for part in text.split(',')] if text.strip()
                   else document.get('site_deg'))
        site = None if not degrees else {
            'latitude': degrees[0] * DEG, 'longitude': degrees[1] * DEG}
        found = (self.session.judge(site) if again
                 else self.session.diagnose(document.get('alpha', 0.01), site))
        if document:
            self._check.compare('diagnosis', logged, json.dumps(found.document), _at(stamp))
        # the report of the fit comes with it, its witnesses judged by the new model
        report = self.session.report
        logged = (self._report(report['last_stamp_ns'])
                  if 'published' in document and report is not None else None)
        if logged is not None:
            self._check.compare('report', logged, json.dumps(report), _at(stamp))
        return found.model

    def _report(self, stamp):
        """The next one of the log, of a fit at `stamp`; fits that were refused had one too."""
        while self._reports:
            made = _stamp_of(self._reports[0], stamp)
            if made > stamp:
                return None
            logged = self._reports.popleft()
            if made == stamp:
                return logged
        return None


def _stamp_of(report, default):
    return _document(report).get('last_stamp_ns', default)


def _document(text):
    """What a JSON text tells; nothing, where it is no such document."""
    try:
        found = json.loads(text)
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}
