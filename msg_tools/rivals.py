"""One graph in a namespace: who else is, or publishes, what a node is, and which of them ends.

Endpoints alone do not tell: that of a node that was killed stays in the graph until its lease ends.
Who speaks on `/diagnostics` lives.
"""

import os
import socket
import time
import uuid

from .readiness import is_count

#: key of a row of diagnostics: when a node was started, ns, and what tells it from all others
INSTANCE = 'instance'


def new_instance(now=None):
    """What tells a node that starts now from all others, str."""
    start = time.time_ns() if now is None else now
    return f'{start} {socket.gethostname()} process {os.getpid()} {uuid.uuid4().hex[:8]}'


def _order(instance):
    """Instances in the order in which they were started, whoever compares; None for no such."""
    start, _, rest = instance.partition(' ')
    return (int(start), rest) if is_count(start) else None


def earlier_rival(own, name, topics, status):
    """Whether a status is that of a node before which another has to go.

    Parameters
    ----------
    own : str
        Instance of the node that asks.
    name : str
        Its full name.
    topics : iterable of str
        Full names of what it alone may publish.
    status : DiagnosticStatus
        Of any node.

    Returns
    -------
    str
        What both are or publish, and who the other is; '' where it is none, or was started later.
    """
    rows = {row.key: row.value for row in status.values}
    other = rows.get(INSTANCE, '')
    if _order(other) is None or _order(other) >= _order(own):
        return ''
    common = [topic for topic in topics if f'publishes {topic}' in rows]
    if status.name != name and not common:
        return ''
    who = f'{status.name} ({other.partition(" ")[2].rpartition(" ")[0]})'
    if common:
        return f'{common[0]} is published by {who} already'
    return f'{who} is running already'
