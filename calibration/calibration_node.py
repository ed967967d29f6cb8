"""The calibration: sets the zero on Polaris or stars and fits the pointing model, when asked."""

import json
import sys
from copy import deepcopy
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from std_msgs.msg import String
from std_srvs.srv import Trigger

from msg_tools import convert, topics
from msg_tools.homing import cloud_to_homing
from msg_tools.long_work import LongWork
from msg_tools.node import MountNode
from msg_tools.node_process import give_back, run_node
from msg_tools.status import Progress, handover_rows
from msg_tools.units import ARCSEC
from pointing_model.effects import declared_graduation
from pointing_model.in_force_message import text_to_pair
from pointing_model.model import PointingModel
from pointing_model.model_document import identity
from pointing_model.runs.run_messages import cloud_to_run, run_to_cloud
from pointing_model.sky.skyline import parse_horizon
from pointing_model.zero_message import zero_to_joints

from .analysis.encoders.cross_check import UNJUDGED, homings_of
from .analysis.external_check import ways
from .analysis.harmonic_fit import choice_of
from .analysis.held_out import steps_of
from .analysis.tracking import TRACK
from .calibration_params import PARAMS, site_of
from .distrust import contradicted
from .live_apart import LiveApart
from .nights import NightSeries
from .power_on_cache import document_text
from .session import CalibrationSession

#: power-ons whose begin is known: the zero of a later one is published
STARTS = 100


class Calibration(MountNode):
    """Collects observations; publishes zero, model and report, latched."""

    GATHER = 0.005  # clock, status and rows of a simulated night at once

    def __init__(self, **kwargs):
        super().__init__('calibration', PARAMS, hardware_id='pointing model', **kwargs)
        reference = None
        if self.value('model_file'):
            reference = PointingModel.load(self.value('model_file'))
        seed, age = self.value('split_seed'), self.value('reference_age')
        harmonics = choice_of({name: self.value(name) for name in (
            'harmonics', 'harmonics_alone', 'harmonics_degree', 'harmonics_rcond')})
        kept = self.value('kept_power_ons')
        self._session = (NightSeries(age, reference, seed, harmonics, kept) if age else
                         CalibrationSession(reference, seed, harmonics=harmonics, power_ons=kept))
        if age and self.value('mode') == TRACK:
            raise ValueError('mode track follows one night after the other by itself: leave out '
                             'reference_age')
        self._skyline = parse_horizon(self.value('horizon'))
        self._tracking = None
        if self.value('mode') == TRACK:
            from .analysis.tracking.live_tracking import LiveTracking
            self._tracking = LiveTracking()
        self._apart, self._alarms = LiveApart(), []
        self._finding = self._refused = ''
        self._model_name = identity(reference.to_json() if reference else '')
        self._spoke = False  # a zero or a model is published
        self._contradiction = ''  # why the last model was not
        self._observer = None  # how far its plan is
        self._taken_up = []  # from others, after a start in the middle of a night
        self._starts = {}  # number of a power-on -> when it began
        self._marks = None  # what the incremental encoder says of them
        self._zero_pub = self.publisher(topics.ZERO)
        self._expected_pub = self.publisher(topics.ZERO_EXPECTED)
        self._expected_of = None  # the power-on whose zero was told last
        self._model_pub = self.publisher(topics.MODEL)
        self._report_pub = self.publisher(topics.CALIBRATION_REPORT)
        self._diagnosis_pub = self.publisher(topics.DIAGNOSIS)
        self._status_pub = self.publisher(topics.CALIBRATION_STATUS)
        self._table_pub = self.publisher(topics.CALIBRATION_TABLE)
        self._tracking_pub = self.publisher(topics.TRACKING)
        self._apart_pub = self.publisher(topics.APART)
        self._long = LongWork(self)
        # OBSERVATIONS is latched: after a restart it brings back the night so far
        for topic, call in ((topics.OBSERVATION, self._on_observation),
                            (topics.OBSERVATIONS, self._on_table),
                            (topics.HOMING, self._on_homing),
                            (topics.OBSERVER_STATUS, self._on_observer),
                            (topics.IN_FORCE, self._on_in_force)):
            self.subscribe(topic, self._long.waiting(call))
        for name, work in (('calibrate_zero', self._work_zero), ('fit', self._work_fit),
                           ('judge', self._work_judge)):
            self.create_service(Trigger, name, partial(self._answer, work))
        self.create_service(Trigger, 'diagnose', self._on_diagnose)
        self.serve('~/cancel', self._long.cancel)
        self.every(1.0, self._tell_stage)
        self._say('knows nothing of the night yet: no observation, no zero, no model')

    def _on_observation(self, message):
        run = self._rows(message)
        self._session.add(run, convert.from_stamp(message.header.stamp))
        self._note_starts(run)
        self._ask(self._apart.observed(self._session))
        if self._tracking and self._tracking.observed(self._session, run):
            self._publish_tracked()  # before the observer hears that the row was taken
        else:
            self._say('collecting')
        self._expect_zero()

    def _on_table(self, message):
        if message.width:
            run = self._rows(message)
            new = self._session.take_table(run, convert.from_stamp(message.header.stamp))
            self._note_starts(run)
            if new > 1:  # it may overtake its last row
                self._take_up_rows()
            else:
                self._say('collecting')

    # --- started anew, this node or another -----------------------------------------------------

    def _publish_tracked(self):
        """The model after a star, and what it said."""
        model, zero = self._tracking.pair(self._session)
        self._send_model(model)
        self._spoke = True
        self._zero_pub.publish(zero_to_joints(zero, self._session.last_stamp,
                                              self._session.names.keys))
        self._tracking_pub.publish(String(data=json.dumps(self._tracking.document())))
        self._say(self._tracking.sentence())

    def _take_up_rows(self):
        with_zero = self._session.zeros_again()
        told = ways(self._session.zeros.values()) or 'Polaris'
        if self._tracking:
            self._tracking.again(self._session)
        self._taken_up = [f'{len(self._session)} observations', f'zeros by {told} of power-ons '
                          + (', '.join(map(str, with_zero)) or 'none')]
        self._say_taken_up()

    def _say_taken_up(self):
        model = ('the model in force' if self._session.in_force is not None else
                 'no model is known until the next fit')
        self._say(f'started in the middle of a night: took up {", ".join(self._taken_up)}; {model}')

    def _on_in_force(self, message):
        """Of a calibration before: what it has published died with it."""
        if self._spoke or self.value('reference_age'):
            return
        text, stamp, zero = text_to_pair(message.data)
        if text:
            model = PointingModel.from_json(text)
            if not (self._tracking and self._tracking.take_up(
                    self._session, model)):
                self._session.take_up(model)
            self._model_pub.publish(String(data=text))
        self._model_name, self._spoke = identity(text), True
        self._zero_pub.publish(zero_to_joints(zero, stamp, self._session.names.keys))
        self._taken_up.append('the zero in force')
        self._say_taken_up()

    def _on_observer(self, message):
        progress = Progress.read(message)
        if progress.observations or not len(self._session):
            self._observer = progress
            return
        run = self._session.observations()
        self._table_pub.publish(run_to_cloud(run, self._session.last_stamp))
        self._say('gave the rows of the night to an observer that has none',
                  **handover_rows(len(run), self._observer))

    def _note_starts(self, run):
        if 'encoder_start' in run and 'run' in run:
            known = np.isfinite(run['encoder_start'])
            self._starts.update(zip(run['run'][known].astype(int).tolist(),
                                    run['encoder_start'][known].tolist()))
            for number in sorted(self._starts)[:-STARTS]:
                del self._starts[number]

    def _rows(self, message):
        rows = cloud_to_run(message)
        rows.meta['skyline'] = self._skyline
        if self.value('graduation'):
            rows.meta['graduation'] = declared_graduation(self.value('graduation'))
        return rows

    def _on_homing(self, message):
        self._marks = cloud_to_homing(message)
        if self.value('reference_age'):
            self._session.hear(homings_of(self._marks, 0))

    def _unjudged(self):
        """Whether an incremental encoder is there that tells nothing of its marks."""
        return self._marks is None and self.count_publishers(
            self.resolve_topic_name(topics.INCREMENTAL.name)) > 0

    def _homings(self):
        if self._unjudged():
            return None
        # an encoder that has lost its zero since says so itself
        return [homing for homing in homings_of(self._marks or {}, self._session.newest)
                if homing.homed]

    def _say(self, text, level=DiagnosticStatus.OK, **values):
        self._status_pub.publish(convert.status(
            level, self.get_fully_qualified_name(), text,
            **{**self._session.taken.rows(), **values}))

    def _answer(self, work, request, response):
        """What `work` has done, or why it could not."""
        try:
            self._refuse_beside_another()
            response.message = work()
            response.success = True
        except (ValueError, np.linalg.LinAlgError) as err:
            response.message = str(err)
            self._say(response.message)
        return response

    def _work_zero(self):
        if self._tracking and self._tracking.night is not None:
            done = 'the zero is followed with each star; nothing is set anew'
            self._say(done)
            return done
        run, zero = self._session.calibrate_zero()
        old = self._session.reference
        if self.value('reference_age') and old is not None:
            # the zero goes with the model that it is relative to
            self._send_model(self._dated(old))
        self._publish_zero(zero)
        first, second = zero.mount.names.axes
        done = (
            f'zero of power-on {run} by {zero.by}: {first} {zero.az / ARCSEC:+.2f} +- '
            f'{zero.sigma_az / ARCSEC:.2f} arcsec, {second} {zero.el / ARCSEC:+.2f} +- '
            f'{zero.sigma_el / ARCSEC:.2f} arcsec, relative to {zero.reference}')
        few = zero.n - zero.rejected < self.value('least_exposures')
        if few:
            done += f'; {zero.n - zero.rejected} exposures only'
        self._say(done, DiagnosticStatus.WARN if few else DiagnosticStatus.OK,
                  power_on=run, by=zero.by, exposures=zero.n, rejected=zero.rejected,
                  azimuth_arcsec=f'{zero.az / ARCSEC:.3f}',
                  elevation_arcsec=f'{zero.el / ARCSEC:.3f}',
                  sigma_azimuth_arcsec=f'{zero.sigma_az / ARCSEC:.3f}',
                  sigma_elevation_arcsec=f'{zero.sigma_el / ARCSEC:.3f}',
                  contains=zero.statement())
        return done

    def _dated(self, model):
        return replace(model, provenance={
            **model.provenance, 'last_stamp_ns': self._session.last_stamp})

    def _send_model(self, model):
        text = model.to_json()
        self._model_name, self._spoke = identity(text), True
        self._model_pub.publish(String(data=text))

    def _expect_zero(self):
        """Once a power-on, from what the nights before it followed."""
        if not self.value('reference_age') or self._session.newest == self._expected_of:
            return
        number = self._session.newest
        self._expected_of = number
        found = self._session.expect()
        if found is None:
            return
        axes = [found[axis] for axis in convert.AXES]
        self._expected_pub.publish(convert.joint_state(
            self._session.last_stamp, [axis['change_arcsec'] * ARCSEC for axis in axes],
            effort=[np.nan if axis['sigma_arcsec'] is None else axis['sigma_arcsec'] * ARCSEC
                    for axis in axes],
            frame=f'power_on_{number}', names=self._session.names.keys))

    def _publish_zero(self, zero):
        """With what it holds for: its power-on and the model."""
        self._spoke = True
        bound = replace(zero, model=self._model_name, started=self._starts.get(zero.run))
        self._zero_pub.publish(
            zero_to_joints(bound, self._session.last_stamp, self._session.names.keys))

    def _work_fit(self):
        self._say('fitting')
        self._refuse_contradicted()
        model, report = self._session.fit(self._homings(), self._refuse_contradicted)
        self._send_report(report)
        self._publish_model(model)
        give_back()
        step = steps_of(report)[-1]
        done = (f'{report["stars"]} stars fitted; ' + (
            f'{step["step"]}: {step["held_out"]["radial"]:.2f} arcsec radial on stars held out'
            if step else 'too few to hold some of them out')
                + (f'; {report["rejected"]} rejected' if report['rejected'] else ''))
        if 'refused' in report:
            done = self._refused = report['refused']
        self._say(done, DiagnosticStatus.WARN if 'refused' in report else DiagnosticStatus.OK)
        return done

    def _refuse_contradicted(self, report=None):
        """ValueError where what is known speaks against a model of these observations.

        The report of a fit that is refused is published all the same.
        """
        alarms = self._alarms if report is None else report['witnesses']['alarms']
        why = contradicted(alarms, self._session.observations(), report)
        self._contradiction = why
        if why:
            if report is not None:
                self._send_report(report)
            raise ValueError(why)

    def _publish_report(self):
        """That of the last fit: its alarms are judged again whenever the model changes."""
        if self._session.report is not None:
            self._send_report(self._session.report)

    def _send_report(self, report):
        self._alarms = report['witnesses']['alarms']
        self._report_pub.publish(String(data=document_text(report)))

    def _publish_model(self, model):
        """The model, and the zero that belongs to it; its exposures gave it a little otherwise."""
        self._send_model(model)
        self._session.in_force = model
        self._publish_zero(self._session.zero_of_model)
        if self._tracking:
            self._tracking.begin(self._session)

    def _refuse_beside_another(self):
        if self._long.name:
            raise ValueError(f'{self._long.name} is under way: wait for its end, or call '
                             'calibration/cancel')

    async def _on_diagnose(self, request, response):
        """Seconds or more: in a thread, on a session that counts only when it is done."""
        try:
            self._refuse_beside_another()
            self._say('diagnosing')
            self._refuse_contradicted()
            session = deepcopy(self._session)
            found = await self._long.run('diagnosing', partial(
                session.diagnose, self.value('alpha'), site_of(self.value('site')),
                self.value('diagnosed_at')))
            self._session = session
            self._ask(self._apart.begin(session, found, site_of(self.value('site')),
                                        self.value('diagnosed_at')))  # before its model
            response.message, response.success = self._diagnosed(found), True
        except (ValueError, np.linalg.LinAlgError) as err:
            response.message = str(err)
            self._say(response.message)
        self._long.caught_up(lambda call, err: self.reject(call.__name__, str(err)))
        give_back()
        return response

    def _ask(self, text):
        """Publish how causes stand, if there is anything new."""
        if text:
            self._apart_pub.publish(String(data=text))

    def _tell_stage(self):
        stage, self._long.stage = self._long.stage, ''
        if self._long.name and stage:
            self._say(f'{self._long.name}: {stage}')

    def _diagnosed(self, found):
        document = found.document
        from .report.diagnosis_words import verdict_sentences
        from .report.effect_words import effects_told
        headline, _ = verdict_sentences(document, effects_told(found.diagnosis))
        done = f'{self._publish_finding(found)}; {headline}'
        if document['verdict'] == 'refused':  # the columns are mistaken: nothing is concluded
            done = self._refused = found.diagnosis.caution
        elif self._refused:
            done += f'; {self._refused}'
        done += self._write_page(found)
        self._say_finding(done, document)
        return done

    def _work_judge(self):
        found = self._session.judge(site_of(self.value('site')))
        self._publish_finding(found)
        done = found.document['judged']['why']
        if found.document['judged']['taken_back']:
            done += self._write_page(found)
        self._say_finding(done, found.document)
        return done

    def _write_page(self, found):
        """Why the page was not written, if it was to be."""
        if not self.value('diagnosis_page'):
            return ''
        from .report.diagnosis_page import write_report
        try:
            write_report(found.diagnosis, Path(self.value('diagnosis_page')))
        except OSError as err:
            self.get_logger().error(f'the page was not written: {err}')
            return f'; the page was not written: {err}'
        return ''

    def _publish_finding(self, found):
        """Diagnosis, report, model and zero of an `Amended`; what was found, in words."""
        document = found.document
        self._diagnosis_pub.publish(String(data=json.dumps(document)))
        self._publish_report()
        self._publish_model(found.model)
        self._finding = document['verdict']
        if document['applied']:
            self._finding += ': ' + ', '.join(document['applied'])
        self._refused = '; '.join(f'not published: {entry["why"]}'
                                  for entry in document['refused'])
        return self._finding

    def _say_finding(self, done, document):
        self._say(done, DiagnosticStatus.WARN if self._refused else DiagnosticStatus.OK,
                  verdict=document['verdict'], effects=', '.join(document['applied']),
                  published=document['published'])

    def finish(self):
        """Wait for nothing."""
        self._long.close()

    def required(self):
        """It needs observations."""
        return {self.resolve_topic_name(topics.OBSERVATION.name)}

    def problems(self):
        """What the three witnesses of the last night disagree on, or cannot say."""
        found = [*([self._contradiction] if self._contradiction else []), *self._alarms,
                 *([UNJUDGED] if self._unjudged() else []),
                 *([self._refused] if self._refused else []),
                 *(self._tracking.problems() if self._tracking else [])]
        return [(DiagnosticStatus.WARN, text) for text in found]

    def details(self):
        """What has come."""
        return [('observations', str(len(self._session))),
                ('power-ons with a zero', str(len(self._session.zeros))),
                ('zeros by', ways(self._session.zeros.values()) or 'nothing yet'),
                ('taken up', '; '.join(self._taken_up) or 'nothing: there from the start'),
                ('diagnosis', self._finding or 'none yet'), *self._apart.details(),
                *(self._tracking.details() if self._tracking else [])]


def main(args=None):
    """Entry point of ``ros2 run telescope_mount calibration``."""
    sys.exit(run_node(Calibration, args))


if __name__ == '__main__':
    main()
