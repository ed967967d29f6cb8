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

"""Findings of an analysis as data; `calibration.report.wording` has the sentence of each kind."""

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Finding:
    """One result to report.

    Attributes
    ----------
    kind : str
        Key of its sentence in `calibration.report.wording`.
    size, sigma : float, optional
        Value and standard error, in `unit`.
    unit : str
    causes : tuple of str
        Causes that explain it equally well.
    before, after : float, optional
        Figure of merit without and with it, arcsec.
    todo : str
        Key of the recommended action.
    evidence : dict
        Other values for the sentence.
    caution : bool
        Whether it is reported first: it shows where to look, or puts other results in doubt.
    """

    kind: str
    size: float | None = None
    sigma: float | None = None
    unit: str = 'arcsec'
    causes: tuple = ()
    before: float | None = None
    after: float | None = None
    todo: str = ''
    evidence: dict = field(default_factory=dict)
    caution: bool = False

    def __getitem__(self, name):
        """One of `evidence`."""
        return self.evidence[name]


def far_outside(what, value, measured):
    """A Finding if `value` is beyond the measured ones by more than half their range, in a list."""
    low, high = float(np.nanmin(measured)), float(np.nanmax(measured))
    if not abs(value - (low + high) / 2.0) > high - low:  # also NaN
        return []
    return [Finding('cause far outside', float(value), unit='', caution=True, evidence={
        'what': what, 'low': low, 'high': high})]


def is_caution(found):
    """Whether a Finding, or a note of a run, is reported first."""
    return getattr(found, 'caution', False)


def cautions_first(findings):
    """Sort findings: cautions before the others."""
    return sorted(findings, key=lambda one: not is_caution(one))
