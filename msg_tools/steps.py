"""Work that waits for others: steps that are gone on with whenever something has changed.

Such work is a generator of conditions. Nothing here knows ROS, threads or sleep: whoever changes
what a condition looks at (a message, a timer, the answer of a service) calls `Steps.advance`.
"""


class Refused(Exception):
    """A step cannot be done; the text says why."""


class Steps:
    """Runs one piece of work at a time.

    Parameters
    ----------
    ended : callable
        Called with None when the work is finished, with the `Refused` or ValueError that ended it
        otherwise. Other errors of the work pass.
    """

    def __init__(self, ended):
        self._ended = ended
        self._work = None
        self._wait = None
        self._running = False

    @property
    def busy(self):
        """Whether there is work that has not ended."""
        return self._work is not None

    def start(self, work):
        """Take up `work`, a generator of callables that say whether it may go on.

        It begins with the next `advance`; RuntimeError while other work is under way.
        """
        if self.busy:
            raise RuntimeError('work is under way')
        self._work, self._wait = work, None

    def end(self, error):
        """Give the work up: `ended` is called with `error`, a `Refused`."""
        work, self._work = self._work, None
        if work is not None:
            work.close()
            self._ended(error)

    def cancel(self):
        """Give the work up, without a word to anybody."""
        if self._work is not None:
            self._work.close()
        self._work = self._wait = None

    def advance(self):
        """Go on as far as the conditions allow."""
        if self._work is None or self._running:  # what a step sets off may call again
            return
        self._running = True
        try:
            while self._wait is None or self._wait():
                self._wait = next(self._work)
        except StopIteration:
            self._work = None
            self._ended(None)
        except (Refused, ValueError) as err:
            self._work = None
            self._ended(err)
        finally:
            self._running = False


def until(condition, what=''):
    """The step that waits for `condition`; `what` is for those who tell people."""
    yield condition


def call(verb, client, wake, wait=until):
    """The steps of a service call.

    Parameters
    ----------
    verb : str
        What is asked for, for people.
    client : rclpy.client.Client
        Of a service whose answer has ``success`` and ``message`` (std_srvs/Trigger).
    wake : callable
        Calls `Steps.advance`: no message need follow the answer.
    wait : callable
        ``wait(condition, what)`` gives the steps that wait for something.

    Returns
    -------
    str
        Its answer, after `verb`.

    Raises
    ------
    Refused
        The answer is no.
    """
    yield from wait(client.service_is_ready, f'a server of {client.srv_name}')
    future = client.call_async(client.srv_type.Request())
    future.add_done_callback(lambda _: wake())
    yield from wait(future.done, f'{client.srv_name} to answer')
    answer = future.result()
    if not answer.success:
        raise Refused(f'{verb}: {answer.message}')
    return f'{verb}: {answer.message}'
