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

"""The calibration: sets the zero on Polaris or stars and fits the pointing model, when asked."""

import json
from dataclasses import replace
from functools import partial

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from std_msgs.msg import String

from msg_tools import convert, topics
from msg_tools.cloud_tables import table_to_cloud
from msg_tools.homing import cloud_to_homing
from msg_tools.long_work import LongWork
from msg_tools.node import MountNode
from msg_tools.node_process import give_back
from msg_tools.status_rows import Progress, Stage, handover_rows
from msg_tools.whole_files import write_text
from pointing_model.calibration_messages import (
    text_to_pair,
    zero_identity,
    zero_to_joints,
)
from pointing_model.effects import declared_graduation
from pointing_model.model import PointingModel
from pointing_model.model_document import identity
from pointing_model.runs.run_messages import cloud_to_run, run_to_cloud
from pointing_model.sky.skyline import parse_horizon

from .analysis.encoders.cross_check import axis_homings
from .calibration_figures import calibration_figures, expected_figures, residual_table
from .calibration_params import PARAMS, site_of
from .calibration_state import Contradiction
from .night_series import state_of
from .report import calibration_wording as words
from .report.track_wording import last_update
from .report.wording import paragraph, worded


class Calibration(MountNode):
    """Collects observations; publishes zero, model and report, latched."""

    GATHER = 0.005  # handles clock, status and rows of a simulated night together

    def __init__(self, **kwargs):
        super().__init__('calibration', PARAMS, hardware_id='pointing model', **kwargs)
        reference = None
        if self.value('model_file'):
            reference = PointingModel.load(self.value('model_file'))
        self._state = state_of({param.name: self.value(param.name) for param in PARAMS}, reference)
        self._skyline = parse_horizon(self.value('horizon'))
        self._model_name = identity(reference.to_json() if reference else '')
        self._has_published = False  # a zero or a model is published
        self._finding = self._refused = ''  # for the diagnostics
        self._observer = None  # progress of its plan
        self._taken_up = []  # what was received from other nodes after a start in mid-night
        self._marks, self._marks_stamp = None, 0  # of the incremental encoder, and their time, ns
        self._expected_of = None  # the power-on whose predicted zero is published
        self._left = None  # residuals of the stars from the active model
        self._pubs = {topic.name: self.publisher(topic) for topic in (
            topics.ZERO, topics.ZERO_IDENTITY, topics.ZERO_POSE, topics.ZERO_EXPECTED, topics.MODEL,
            topics.CALIBRATION_REPORT, topics.DIAGNOSIS, topics.CALIBRATION_STATUS,
            topics.CALIBRATION_TABLE,
            topics.TRACKING, topics.DISCRIMINATION, topics.CALIBRATION_FIGURES,
            topics.CALIBRATION_RESIDUALS, topics.CALIBRATION_RESIDUAL)}
        self._long = LongWork(self)
        # OBSERVATIONS is latched: after a restart it brings back the night so far
        waiting = self._long.waiting
        self.subscribe(topics.OBSERVATION, waiting(self._on_observation))
        self.subscribe(topics.OBSERVATIONS, waiting(self._on_table))
        self.subscribe(topics.HOMING, waiting(self._on_homing))
        self.subscribe(topics.OBSERVER_STATUS, waiting(self._on_observer))
        self.subscribe(topics.ACTIVE, waiting(self._on_active))
        for name, work in (('calibrate_zero', self._work_zero), ('fit', self._work_fit),
                           ('judge', self._work_blind_check)):
            self.serve(name, partial(self._answer, work), once=True)
        self.serve('diagnose', self._work_diagnosis, once=True)
        self.serve('~/cancel', self._long.cancel)
        self.every(1.0, self._publish_stage)
        self._publish_status('knows nothing of the night yet: no observation, no zero, no model')

    def _publish(self, topic, content):
        """Publish a message, a text, or a document as JSON."""
        if isinstance(content, dict):
            content = json.dumps(content)
        self._pubs[topic.name].publish(
            String(data=content) if isinstance(content, str) else content)

    def _on_observation(self, message):
        run = self._rows(message)
        tracked = self._state.add(run, convert.from_stamp(message.header.stamp))
        self._publish_request()
        if tracked:
            self._publish_tracked()  # before the status that tells the observer the row has come
        else:
            self._publish_status('collecting')
        self._expect_zero()

    def _on_table(self, message):
        if message.width:
            run = self._rows(message)
            new = self._state.add_table(run, convert.from_stamp(message.header.stamp))
            if new > 1:  # one new row: the table has only overtaken it
                self._taken_up = [words.rows_sentence(self._state.rows.taken, self._state.zeros)]
                self._publish_restart()
            else:
                self._publish_status('collecting')

    # --- restarts, of this node or another --------------------------------------------------------

    def _publish_tracked(self):
        """Publish the adaptive model after a star, and its document."""
        night = self._state.tracked
        model, zero = night.pair(self._state.last_stamp)
        self._send_model(model)
        self._send_zero(zero)
        self._publish(topics.TRACKING, worded(night.document()))
        self._publish_status(last_update(night))

    def _publish_restart(self):
        self._publish_status(words.restart_sentence(self._taken_up, self._state.model))

    def _on_active(self, message):
        """Take over the active model and zero of an earlier calibration process.

        Its latched messages ended with it, so they are published again.
        """
        if self._has_published or self.value('reference_age'):
            return
        text, stamp, zero = text_to_pair(message.data)
        if text:
            self._state.take_up(PointingModel.from_json(text))
            self._publish(topics.MODEL, text)
        self._model_name, self._has_published = identity(text), True
        self._send_zero(zero, stamp)
        self._taken_up.append('the active zero')
        self._publish_restart()

    def _on_observer(self, message):
        progress = Progress.read(message)
        if progress.observations or not self._state.rows.taken.kept:
            self._observer = progress
            return
        run = self._state.rows.all()
        self._publish(topics.CALIBRATION_TABLE, run_to_cloud(run, self._state.last_stamp))
        self._publish_status('gave the rows of the night to an observer that has none',
                             **handover_rows(len(run), self._observer))

    def _rows(self, message):
        rows = cloud_to_run(message)
        rows.meta['skyline'] = self._skyline
        if self.value('graduation'):
            rows.meta['graduation'] = declared_graduation(self.value('graduation'))
        return rows

    def _on_homing(self, message):
        self._marks = cloud_to_homing(message)
        self._marks_stamp = convert.from_stamp(message.header.stamp)
        if self._state.season is not None:
            self._state.season.update_marks(axis_homings(self._marks, 0))

    def _marks_unknown(self):
        """Whether there is an incremental encoder that has published no reference marks."""
        return self._marks is None and self.count_publishers(
            self.resolve_topic_name(topics.INCREMENTAL.name)) > 0

    def _homings(self):
        if self._marks_unknown():
            return None
        # an encoder that has lost its zero since is not `homed`
        run = self._state.rows.newest
        return [homing for homing in axis_homings(self._marks or {}, run) if homing.homed]

    def _publish_status(self, text, warn=False, **values):
        """Publish a text on the status topic; returns the text."""
        self._publish(topics.CALIBRATION_STATUS, convert.status(
            DiagnosticStatus.WARN if warn else DiagnosticStatus.OK,
            self.get_fully_qualified_name(), text,
            **{**self._state.rows.taken.rows(), **values}))
        return text

    def _answer(self, work):
        """Service response: success and the text of `work`, or failure and the reason."""
        try:
            self._refuse_beside_another()
            return True, work()
        except (ValueError, np.linalg.LinAlgError) as err:
            return self._refusal(err)

    def _refusal(self, error):
        """Service response of a failure; the report of a refused fit is published nevertheless."""
        if isinstance(error, Contradiction) and error.report is not None:
            self._publish(topics.CALIBRATION_REPORT, error.report)
        return False, self._publish_status(str(error))

    def _work_zero(self):
        if self._state.tracked is not None:
            return self._publish_status('the zero is followed with each star; nothing is set anew')
        run, zero = self._state.calibrate_zero()
        if self.value('reference_age') and self._state.reference is not None:
            # publish the reference model with the zero that is relative to it
            self._send_model(self._state.dated_reference)
        self._publish_zero(zero)
        few = zero.n - zero.rejected < self.value('least_exposures')
        return self._publish_status(
            words.zero_sentence(run, zero, few), few, **words.zero_values(run, zero))

    def _send_model(self, model):
        text = model.to_json()
        self._model_name, self._has_published = identity(text), True
        self._publish(topics.MODEL, text)

    def _expect_zero(self):
        """Publish the predicted zero once per power-on, from the causes found on earlier nights."""
        number = self._state.rows.newest
        if self._state.season is None or number == self._expected_of:
            return
        self._expected_of = number
        if expected := self._state.expect():
            self._publish(topics.ZERO_EXPECTED, convert.figures(
                self._state.last_stamp, expected_figures(expected)))

    def _publish_zero(self, zero):
        """Publish a zero with the power-on and the model it is valid for."""
        self._send_zero(replace(zero, model=self._model_name,
                                started=self._state.started(zero.run)))

    def _send_zero(self, zero, stamp=None):
        self._has_published = True
        stamp = self._state.last_stamp if stamp is None else stamp
        self._publish(topics.ZERO_IDENTITY, zero_identity(zero, stamp))
        self._publish(topics.ZERO, zero_to_joints(zero, stamp, self._state.mount.names.keys))
        self._publish(topics.ZERO_POSE, convert.pose(stamp, zero.angles, zero.covariance))
        tracked = self._state.tracked
        self._publish(topics.CALIBRATION_FIGURES, convert.figures(
            stamp, calibration_figures(self._state.model, zero, self._state.report,
                                       tracked and tracked.document(), self._left)))

    def _work_fit(self):
        self._publish_status('fitting')
        model, report = self._state.fit(self._homings())
        report['homing_stamp_ns'] = self._marks_stamp
        self._publish(topics.CALIBRATION_REPORT, report)
        self._publish_model(model)
        give_back()
        done = words.fit_sentence(report)
        if 'refused' in report:
            self._refused = done
        return self._publish_status(done, 'refused' in report)

    def _publish_model(self, model):
        """Publish the model and its zero, which differs a little from that of exposures alone."""
        table = self._left = self._state.active and residual_table(
            self._state.active, self._state.rows.all(), site_of(self.value('site')))
        self._send_model(model)
        self._publish_zero(self._state.zero_of_model())
        if table is not None:
            self._publish(topics.CALIBRATION_RESIDUALS, table_to_cloud(
                table, self._state.last_stamp,
                self._state.mount.direction(table['azimuth'], table['elevation'])))
            for time, right, up in zip(table.get('time', ()), table['residual_right'],
                                       table['residual_up']):
                if time > 0.0:  # rows without a time are no time series
                    self._publish(topics.CALIBRATION_RESIDUAL,
                                  convert.sky_vector(round(time * 1e9), right, up))

    def _refuse_beside_another(self):
        if self._long.name:
            raise ValueError(f'{self._long.name} is under way: wait for its end, or call '
                             'calibration/cancel')

    async def _work_diagnosis(self):
        """Diagnose in a thread, for it takes seconds or more; apply the result when finished."""
        state, until = self._state, self.value('diagnosed_at')
        site = site_of(self.value('site'))
        try:
            self._refuse_beside_another()
            declared_graduation(self.value('graduation'), state.mount.names)  # checks the axes
            self._publish_status('diagnosing')
            found = await self._long.run('diagnosing', partial(
                state.find_effects, self.value('alpha'), site, until))
            state.apply(found, site, until)
            self._publish_request()  # before its model
            answer = True, self._diagnosed(found)
        except (ValueError, np.linalg.LinAlgError) as err:
            answer = self._refusal(err)
        self._long.caught_up(lambda call, err: self.reject(call.__name__, str(err)))
        give_back()
        return answer

    def _publish_request(self):
        """Publish the state of the discrimination between causes, if it is new."""
        if text := self._state.requests.news():
            self._publish(topics.DISCRIMINATION, text)

    def _publish_stage(self):
        at, self._long.stage = self._long.stage, Stage()
        if self._long.name and at.stage:
            self._publish_status(f'{self._long.name}: {at}', **at._asdict())

    def _diagnosed(self, found):
        document = found.document
        done = f'{self._publish_finding(found)}; {words.headline(found)}'
        if document['verdict'] == 'refused':  # mistaken columns: no conclusion
            done = self._refused = paragraph(found.diagnosis.cautions)
        elif self._refused:
            done += f'; {self._refused}'
        return self._finding_status(done + self._write_page(found), document)

    def _work_blind_check(self):
        found = self._state.check_on_blind_stars(site_of(self.value('site')))
        self._publish_finding(found)
        done = found.document['judged']['why']
        if found.document['judged']['taken_back']:
            done += self._write_page(found)
        return self._finding_status(done, found.document)

    def _write_page(self, found):
        """Write the page if asked to; returns why it failed, else ''."""
        if not self.value('diagnosis_page'):
            return ''
        from .report.diagnosis_page import render
        from .report.diagnosis_view import view_of
        try:
            write_text(self.value('diagnosis_page'), render(view_of(found.diagnosis)))
        except OSError as err:
            self.get_logger().error(f'the page was not written: {err}')
            return f'; the page was not written: {err}'
        return ''

    def _publish_finding(self, found):
        """Publish diagnosis, report, model and zero of a `NightDiagnosis`; returns a sentence."""
        document = found.document
        self._publish(topics.DIAGNOSIS, document)
        if self._state.report is not None:  # its alarms depend on the model
            self._publish(topics.CALIBRATION_REPORT, self._state.report)
        self._publish_model(found.model)
        self._finding = words.finding_sentence(document)
        self._refused = words.refusal_sentences(document)
        return self._finding

    def _finding_status(self, done, document):
        return self._publish_status(
            done, bool(self._refused), verdict=document['verdict'],
            effects=', '.join(document['applied']), published=document['published'])

    def finish(self):
        """Shut down without waiting for work in progress."""
        self._long.close()

    def required(self):
        """It needs observations."""
        return {self.resolve_topic_name(topics.OBSERVATION.name)}

    def problems(self):
        """Where the encoders and the sky of the last night disagree, or cannot be compared."""
        return [(DiagnosticStatus.WARN, text) for text in words.problem_sentences(
            self._state, self._marks_unknown(), self._refused)]

    def details(self):
        """Rows received, and the results so far."""
        return words.state_rows(self._state, self._taken_up, self._finding)
