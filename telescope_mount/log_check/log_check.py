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

"""Recomputes every derived number of a log from its inputs, and compares."""

import copy
import json
from collections import deque
from functools import partial
from pathlib import Path

from calibration.analysis.encoders.cross_check import (
    axis_homings,
    diagnostic_homings,
    encoder_diagnostics,
)
from calibration.analysis.harmonic_fit import choice_of_report
from calibration.estimation.false_alarms import ALPHA
from calibration.night_series import state_of
from msg_tools import topics
from msg_tools.bag.bag_pair import parameters_of
from msg_tools.bag.sqlite import open_bag
from msg_tools.bag.topic_names import prefix_of
from msg_tools.convert import from_stamp, read_sky_vector
from msg_tools.homing import cloud_to_homing
from msg_tools.units import DEG
from pointing_model.calibration_messages import joints_to_zero
from pointing_model.model import PointingModel
from pointing_model.model_document import KEY
from pointing_model.runs.run_messages import cloud_to_run
from telescope_mount.observing.camera_delay import offset_of

from ..input_files.run_loader import declared_by
from .log_comparison import LogComparison, same_document
from .observation_check import RAW, Pairing, at_time, began_anew

#: number of encoder homing states around a fit that are tried, for a report without its own
_STATES = 3


def verify_log(bag, *, reference=None, seed=None, progress=None):
    """Recompute zeros, models, reports and diagnoses of a log, and the observations, too.

    Observations are computed from encoder readings and miss distances; the rest from the
    observations, in a new calibration without a ROS graph. A number is right if it agrees within
    rounding.

    Parameters
    ----------
    bag : str or Path
        Log of a night.
    reference : str or Path, optional
        The reference model of the night; by default that in the log.
    seed : int, optional
        Seed of the choice of held-out stars; by default that of the log, or 1.
    progress : callable, optional
        Called with (text, done, total) for progress.

    Returns
    -------
    dict
        ``checked`` (kind -> count), ``rounded`` (how many of these agree only within rounding),
        ``differences`` and ``unchecked``, one line each; ``damaged``, whether the log is.

    Raises
    ------
    ValueError
        The log has nothing derived, or the simulator's truth; its time went back; or the
        reference is missing.
    OSError
        The log cannot be read.
    """
    log = open_bag(bag)
    prefix = prefix_of(log)
    if not any(t.name == f'{prefix}{topics.OBSERVATION.name}' and t.count for t in log.topics):
        raise ValueError(f'{bag} has no observation in it; it is no log of a night')
    back = began_anew(log)
    if back:
        raise ValueError(
            f'{bag}: time jumps back from {at_time(back[0][0])} to {at_time(back[0][1])}: a '
            f'simulator or replay was restarted, and {len(back) + 1} parts overlap. Restart '
            'the whole graph, with another folder')
    check = LogComparison()
    rows = _read(log, prefix, check)
    parameters = parameters_of(log.metadata, f'{prefix}calibration') or {}
    if not parameters:
        check.unchecked.append('no parameters of the calibration in the log: '
                               'defaults used, all power-ons kept (see --seed, '
                               '--reference)')
    declared = declared_by(parameters, check.unchecked)
    for part in (*rows.observations.values(), *rows.tables.values()):
        part.meta |= declared
    state = _state(log, parameters, reference, seed, rows)
    if state.season is not None:
        for _, homings in rows.homings:
            state.season.update_marks(homings(0))
    _calibrate(rows, state, parameters, check, *([progress] if progress else []))
    if not check.checked:
        raise ValueError(f'{bag} has no results to verify')
    check.unchecked += log.problems
    return {'checked': dict(check.checked), 'rounded': check.rounded,
            'differences': check.differences,
            'unchecked': check.unchecked, 'damaged': bool(log.problems)}


# --- the log, read once --------------------------------------------------------------------------


class _LoggedRows:
    """What the calibration received and published, from a log."""

    def __init__(self):
        self.observations = {}  # stamp -> PointingRun
        self.tables = {}  # stamp -> PointingRun
        self.published = {name: [] for name in ('zero', 'model', 'calibration/report', 'diagnosis',
                                                'apart')}
        #: (log time, callable that returns the homings of a run); of old logs from diagnostics
        self.homings, self.diagnosed = [], []
        self.homings_at = {}  # stamp -> such a callable


def _read(log, prefix, check):
    """One pass over the log; observations are compared with their readings on the way."""
    rows, pairing = _LoggedRows(), Pairing(log, prefix, check)
    names = (*rows.published, *RAW, 'observation', 'observations', 'offset', 'camera/miss_distance',
             'incremental/homing', 'observer/checks')
    clocks = {}
    for message in log.messages([*(prefix + name for name in names), '/diagnostics']):
        name = message.topic.removeprefix(prefix)
        if name in RAW:
            pairing.reading(RAW[name], message)
            continue
        data = log.decode(message)
        if data is None:
            continue
        if name in rows.published:
            rows.published[name].append((message.log_time, data))
        elif name == 'observation':
            stamp = from_stamp(data.header.stamp)
            rows.observations[stamp] = cloud_to_run(data)
            pairing.observation(stamp, rows.observations[stamp])
        elif name == 'observations':
            if data.width:
                rows.tables[from_stamp(data.header.stamp)] = cloud_to_run(data)
        elif name in ('offset', 'camera/miss_distance'):
            taken = pairing.offsets if name == 'offset' else pairing.frames
            taken[from_stamp(data.header.stamp)] = read_sky_vector(data)
        elif name == 'observer/checks':
            found = _document(data.data).get('clocks')
            if found:
                clocks[str(found['exposures'])] = found
        elif name == 'incremental/homing':
            homings = partial(axis_homings, cloud_to_homing(data))
            rows.homings.append((message.log_time, homings))
            rows.homings_at[from_stamp(data.header.stamp)] = homings
        else:
            rows.diagnosed += [(message.log_time, partial(diagnostic_homings, values))
                               for values in encoder_diagnostics(data, prefix)]
    pairing.finish(rows.observations)
    for found in clocks.values():
        check.compare('clocks', json.dumps([found['found'], found['absolute']]), json.dumps(
            [offset_of(found[name]) for name in ('exposures', 'absolute_exposures')]),
            f'star {found["star"]}')
    return rows


# --- the calibration, repeated -------------------------------------------------------------------


def _state(log, parameters, reference, seed, rows):
    model = None
    if reference is not None:
        model = PointingModel.load(reference)
    elif parameters.get('model_file'):
        if any(a.name == 'reference_model.json' for a in log.attachments):
            model = PointingModel.from_json(log.read_attachment('reference_model.json').decode())
        elif Path(parameters['model_file']).is_file():
            model = PointingModel.load(parameters['model_file'])
        else:
            raise ValueError(f'reference model of the night not found: '
                             f'{parameters["model_file"]}; give it with --reference')
    reports = rows.published['calibration/report']
    if not parameters and reports:
        parameters = choice_of_report(_document(reports[-1][1].data)).parameters()
    if seed is not None:
        parameters = {**parameters, 'split_seed': seed}
    return state_of(parameters, model)


def _calibrate(rows, state, parameters, check, progress=lambda *_: None):
    """Feed the observations one by one, and repeat what was requested after each."""
    zeros, models = {}, {}
    for _, data in rows.published['zero']:
        zeros.setdefault(from_stamp(data.header.stamp), []).append(data)
    for log_time, data in rows.published['model']:
        try:
            stamp = json.loads(data.data)['provenance'].get('last_stamp_ns', 0)
        except (ValueError, KeyError, AttributeError, TypeError):
            check.unchecked.append('model skipped: not a model of telescope-mount')
            continue
        models.setdefault(stamp, []).append((log_time, data.data))
    replay = _Replay(state, rows, parameters, check)
    stamps = sorted({*rows.observations, *zeros, *models, *rows.tables})
    for done, stamp in enumerate(stamps):
        progress('computing again', done, len(stamps))
        if stamp in rows.observations:
            replay.state.add(rows.observations[stamp], stamp)
            replay.compare_request()
        elif stamp in rows.tables:
            replay.state.add_table(rows.tables[stamp], stamp)
        if stamp in zeros or stamp in models:
            replay.at(stamp, zeros.get(stamp, []), models.get(stamp, []))


class _Replay:
    """Repeats what the calibration was requested to do at one stamp, and compares."""

    def __init__(self, state, rows, parameters, check):
        self.state, self._rows, self._check = state, rows, check
        self._parameters, self._requests = parameters, {}
        for _, data in rows.published['apart']:
            request = _document(data.data)
            self._requests.setdefault((request.get('diagnosed_ns'), request.get('last_stamp_ns')),
                                      []).append(data.data)
        self._reports, self._diagnoses = (
            deque(data.data for _, data in rows.published[name])
            for name in ('calibration/report', 'diagnosis'))

    def compare_request(self):
        """Compare the request for a star that separates causes, after a row or a diagnosis."""
        text = self.state.requests.news()
        if not text:
            return
        made = json.loads(text)
        key = made['diagnosed_ns'], made['last_stamp_ns']
        for logged in self._requests.pop(key, ()):
            self._check.compare('stars asked for', logged, text, at_time(key[1]))

    def at(self, stamp, zeros, models):
        """Zeros by Polaris first, then fits, then diagnoses, each with its zero."""
        if self.state.last_stamp != stamp:
            self._check.unchecked.append(
                f'results at {at_time(stamp)}: their observation is not in the log')
            return
        made = models[sum(self._is_dated_reference(text) for _, text in models):]
        calibrated = max(0, len(zeros) - len(made))
        computed = []
        if calibrated:
            try:
                run, zero = self.state.calibrate_zero()
            except ValueError as error:
                self._check.differences.append(f'zero of {at_time(stamp)}: {error}')
                return
            computed += [(zero, True)] * calibrated
        for log_time, text in made:
            provenance = json.loads(text)['provenance']
            if KEY in provenance and self.state.tracked is not None:
                model, zero = self.state.tracked.pair(stamp)
                self._check.compare('tracked model', text, model.to_json(), at_time(stamp))
                computed.append((zero, False))
                continue
            if 'refit' in provenance:
                model = self._fit(stamp, log_time)
            elif 'judged' in provenance:
                model = self._diagnose(stamp, again=True)
            elif 'verdict' in provenance:
                model = self._diagnose(stamp)
            else:
                model = self._fit(stamp, log_time)
            self._check.compare('model', text, model.to_json(), at_time(stamp))
            computed.append((self.state.active_zeros.newest, False))
        for data, (zero, by_polaris) in zip(zeros, computed):
            _, logged = joints_to_zero(data)
            self._check.compare('zero', logged.angles, zero.angles, at_time(stamp))
            if by_polaris:
                self._check.compare('sigma of the zero', logged.sigma, zero.sigma, at_time(stamp))

    def _is_dated_reference(self, text):
        """Whether a model is the reference, published with a zero relative to it."""
        reference = self.state.reference
        if not self._parameters.get('reference_age') or reference is None:
            return False
        document, own = json.loads(text), json.loads(reference.to_json())
        for one in (document, own):
            one['provenance'] = {k: v for k, v in one['provenance'].items()
                                 if k != 'last_stamp_ns'}
        return document == own

    def _fit(self, stamp, log_time):
        logged = self._report(stamp)
        before, first, of = self.state, None, _document(logged or '').get('homing_stamp_ns')
        for homings in self._homings(log_time, of):
            state = copy.deepcopy(before)  # a fit is compared with the previous one
            model, report = state.fit(homings)
            if of is not None:
                report['homing_stamp_ns'] = of
            tried = state, model, json.dumps(report)
            first = first or tried
            if logged is None or same_document(logged, tried[-1]):
                break
        else:
            tried = first
        self.state, model, report = tried
        if logged is None:
            self._check.unchecked.append(f'report of {at_time(stamp)}: not in the log')
        else:
            self._check.compare('report', logged, report, at_time(stamp))
        return model

    def _homings(self, log_time, stamp):
        """Candidate homing states of the encoders: at `stamp`, if the report has it; else those
        around `log_time`, the closest first, then none.
        """
        states = self._rows.homings or self._rows.diagnosed
        newest = sum(when <= log_time for when, _ in states) - 1
        near = sorted(range(len(states)), key=lambda i: (abs(i - newest), i))
        known = self._rows.homings_at.get(stamp)
        for homings in [known] if known else [states[i][1] for i in near[:_STATES]]:
            yield [h for h in homings(self.state.rows.newest) if h.homed]
        if not states:
            yield []
        yield None

    def _diagnose(self, stamp, again=False):
        """The model of a diagnosis, or (`again`) of the check on blind stars after it."""
        logged = self._diagnoses.popleft() if self._diagnoses else '{}'
        document = json.loads(logged)
        text = self._parameters.get('site', '')
        degrees = ([float(part) for part in text.split(',')] if text.strip()
                   else document.get('site_deg'))
        site = None if not degrees else {
            'latitude': degrees[0] * DEG, 'longitude': degrees[1] * DEG}
        state = self.state
        found = (state.check_on_blind_stars(site) if again
                 else state.diagnose(document.get('alpha', ALPHA), site))
        self.compare_request()
        if document:
            self._check.compare('diagnosis', logged, json.dumps(found.document), at_time(stamp))
        # the report of the fit is repeated with it: encoders cross-checked by the new model
        report = state.report
        logged = (self._report(report['last_stamp_ns'])
                  if 'published' in document and report is not None else None)
        if logged is not None:
            self._check.compare('report', logged, json.dumps(report), at_time(stamp))
        return found.model

    def _report(self, stamp):
        """The next logged report of a fit at `stamp`; refused fits also have reports."""
        while self._reports:
            made = _document(self._reports[0]).get('last_stamp_ns', stamp)
            if made > stamp:
                return None
            logged = self._reports.popleft()
            if made == stamp:
                return logged
        return None


def _document(text):
    """Parsed JSON object; empty if the text is not one."""
    try:
        found = json.loads(text)
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}
