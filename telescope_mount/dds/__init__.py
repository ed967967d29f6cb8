"""What DDS is told of the network, in environment variables: by default this machine alone."""

import os
from pathlib import Path

RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
#: of Fast DDS, new and old name
PROFILES = ('FASTDDS_DEFAULT_PROFILES_FILE', 'FASTRTPS_DEFAULT_PROFILES_FILE')
#: who sets one of these has named other hosts
_OTHERS = ('ROS_STATIC_PEERS', 'ROS_DISCOVERY_SERVER')


def dds_environment(domain=None):
    """Environment variables with which a graph finds itself quickly, and is found by whom it may.

    Parameters
    ----------
    domain : int, optional
        ROS domain; that of the environment if omitted.

    Returns
    -------
    dict of str to str
        What the user has set already is left as it is, but for the domain.
    """
    out = {} if domain is None else {'ROS_DOMAIN_ID': str(domain)}
    # opening the graph to the network is the user's explicit choice
    wanted = os.environ.get(RANGE) or 'LOCALHOST'
    out[RANGE] = wanted
    if not any(os.environ.get(name) for name in PROFILES):
        here = wanted == 'LOCALHOST' and not any(os.environ.get(name) for name in _OTHERS)
        profile = Path(__file__).parent / ('this_machine.xml' if here else 'network.xml')
        out.update({name: str(profile) for name in PROFILES})
    return out
