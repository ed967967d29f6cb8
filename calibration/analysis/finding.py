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

"""What an analysis finds, as data; `calibration.report.wording` has the sentence of each kind."""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Finding:
    """One thing that people should know.

    Attributes
    ----------
    kind : str
        Which sentence it is; `calibration.report.wording` has one for each.
    size, sigma : float, optional
        What was found and its standard error, in `unit`.
    unit : str
    causes : tuple of str
        What explains it equally well.
    before, after : float, optional
        A figure of merit without and with it, arcsec.
    todo : str
        Key of what to do about it.
    evidence : dict
        What else the sentence needs.
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

    def __getitem__(self, name):
        """One of `evidence`."""
        return self.evidence[name]
