"""The one door from outside to the simulator.

Who calibrates may not know the truth, so nobody else outside of `encoder_sim` names it, but for the
modules of its nodes in `graph.NODES`. What comes through here is a list of names, a bench that
calibrates nothing, and what a scenario did, out of the log of the truth when all is over.
"""

import json

from encoder_sim.indexing_table import SCALES, IndexingTable
from encoder_sim.scenario_file import scenario_names
from encoder_sim.scenario_file import undeclared as _undeclared
from msg_tools.bag import BagReader

__all__ = ['SCALES', 'IndexingTable', 'scenario_names', 'undeclared']


def undeclared(bag):
    """What the scenario of a night did that nobody was told; read when all is over.

    Parameters
    ----------
    bag : str or Path
        Folder of the truth.

    Returns
    -------
    dict or None
        As `encoder_sim.scenario_file.undeclared`; None where the log does not tell.
    """
    from msg_tools import topics
    log = BagReader(bag)
    for topic in log.topics:
        if topic.name.endswith('/' + topics.TRUTH_SCENARIO.name):
            for message in log.messages(topic.name, decode=True):
                return _undeclared(json.loads(message.data.data)[0]['text'])
    return None
