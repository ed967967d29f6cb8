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

"""The command line's own node: watches the graph and keeps the last messages."""

import time

from std_srvs.srv import Trigger

from msg_tools import NAMESPACE, topics
from msg_tools.node import NO_SUBSCRIPTION_EVENTS
from msg_tools.readiness import AWAITED, REST, RESTS, GraphReports, unreceived

from .graph_client import GraphClient


class Watcher(GraphClient):
    """Subscribes to status, diagnostics and results of a graph.

    Parameters
    ----------
    name : str
        Node name.
    domain : int
        ROS domain.
    environment : dict of str to str
        Environment of the graph, from which DDS takes its settings.
    check : callable
        Called while waiting; raises RuntimeError if the graph has failed.

    Attributes
    ----------
    latest : dict of str to message
        Last message of each topic in `KEPT`, by topic name.
    reports : GraphReports
        Reports of all nodes.
    """

    KEPT = (topics.OBSERVER_STATUS, topics.CALIBRATION_STATUS, topics.GUARD_STATUS)
    #: results that grow during the night and are needed at its end: see `keep_results`
    RESULTS = (topics.OBSERVATIONS, topics.MODEL, topics.CALIBRATION_REPORT, topics.ZERO,
               topics.ZERO_IDENTITY, topics.DIAGNOSIS, topics.CHECKS, topics.TRACKING)

    def __init__(self, name, domain, environment, check):
        super().__init__(domain, NAMESPACE, name, environment=environment)
        self.check = check
        self.latest = {}
        self._clients = {}
        self.reports = GraphReports(self.node.get_namespace())
        self._keep(self.KEPT)
        self.node.create_subscription(
            topics.ENDPOINTS.message, topics.ENDPOINTS.name, self.reports.take,
            topics.ENDPOINTS.qos, event_callbacks=NO_SUBSCRIPTION_EVENTS)

    def _keep(self, kept):
        for topic in kept:
            self.node.create_subscription(
                topic.message, topic.name,
                lambda message, key=topic.name: self.latest.__setitem__(key, message), topic.qos,
                event_callbacks=NO_SUBSCRIPTION_EVENTS)

    def keep_results(self):
        """Keep the results of the graph as well, starting with the present ones."""
        self._keep(self.RESULTS)

    def call(self, service, timeout=30.0):
        """Call a Trigger service of the graph; the call is repeated if no answer comes.

        Returns
        -------
        str
            Its answer.

        Raises
        ------
        RuntimeError
            It did not answer or refused.
        """
        try:
            answer, _ = self.ask(Trigger, service, Trigger.Request(), timeout, timeout)
        except ValueError as err:
            raise RuntimeError(str(err)) from None
        if not answer.success:
            raise RuntimeError(f'{service}: {answer.message}')
        return answer.message

    def client(self, service):
        """Client of a Trigger service, cached: discovery of its server takes a moment."""
        if service not in self._clients:
            self._clients[service] = self.node.create_client(Trigger, service)
        return self._clients[service]

    def wait_for_log(self, nodes, timeout):
        """Wait until the logger has received all messages that the nodes have published so far.

        A "stop" message could overtake data on other topics; sequence numbers cannot.

        Parameters
        ----------
        nodes : iterable of str
            Full names of the publishing nodes, including the logger.
        timeout : float
            Seconds.

        Returns
        -------
        dict of str to int
            Topics with missing messages after `timeout` seconds; empty if complete.
        """
        name = f'{NAMESPACE}/mcap_logger'
        # wait for new diagnostics: each node reports at least once a second, and soon after it has
        # come to rest
        seen, rested = dict(self.reports), time.monotonic() + REST

        def silent():
            late = time.monotonic() > rested
            return [n for n in nodes if self.reports.get(n) is seen.get(n)
                    and not (late and n in seen and seen[n][RESTS])]

        if not self.spin_until(lambda: not silent(), timeout):
            raise RuntimeError(f'no diagnostics of {", ".join(silent())} for {timeout:g} s')
        then = dict(self.reports)
        self.spin_until(lambda: not (unreceived(name, self.reports, then)
                                     or self.reports[name][AWAITED]), timeout)
        return unreceived(name, self.reports, then)
