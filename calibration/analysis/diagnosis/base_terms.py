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


"""The declared model: its terms, their design columns, and the terms that rows determine."""

import re
from dataclasses import dataclass, replace

import numpy as np

from calibration.estimation.group_columns import GroupColumns
from pointing_model.harmonics import basis, sky_factor
from pointing_model.mounts import ALTAZ
from pointing_model.pointing_terms import known_terms, stacked_design

from ..term_fit import fit_terms

_SETS = ('physical', 'standard6', 'index')  # attributes of `mount_kinds.MountKind`


@dataclass(frozen=True)
class Base:
    """The declared model.

    Attributes
    ----------
    terms : tuple of str
    degree : int
        Degree of the spherical harmonics of paper 000; 0: none.
    own : tuple of str
        Terms fitted separately to each run.
    interpretation : {'zenith', 'printed'}
        Meaning of E in the harmonics, see `pointing_model.harmonics`.
    """

    terms: tuple
    degree: int = 0
    own: tuple = ()
    interpretation: str = 'zenith'

    @classmethod
    def parse(cls, text, own=(), mount=ALTAZ):
        """Parse ``physical``, ``standard6``, ``index``, ``sh13``, ``sh1``..``sh4``, term names.

        Parameters
        ----------
        text : str
            Parts joined by ``+`` or ``,``. sh13 is sh4: degree 4 has 13 coefficients per axis.
            ``sh4p``: with the paper's E as printed, otherwise E is the zenith distance.
        own : sequence of str
            Terms fitted separately to each run.
        mount : Mount, optional
            Mount with these terms.

        Raises
        ------
        ValueError
            An unknown part.
        """
        terms, degree, interpretation = [], 0, 'zenith'
        for part in re.split(r'[+,\s]+', text.strip()):
            harmonics = re.fullmatch(r'sh(13|[1-4])(p?)', part)
            if harmonics:
                interpretation = 'printed' if harmonics.group(2) else 'zenith'
                degree = 4 if harmonics.group(1) == '13' else int(harmonics.group(1))
            else:
                several = getattr(mount.names, part) if part in _SETS else (part,)
                terms += [t for t in several if t not in terms]
        try:
            known_terms(terms, mount)
        except ValueError as error:
            raise ValueError(f'{error}; or {", ".join(_SETS)}, sh13, or a model file') from None
        known_terms(own, mount)
        return cls(tuple(terms), degree, tuple(own), interpretation)

    @property
    def common(self):
        """Terms that all runs share."""
        return tuple(t for t in self.terms if t not in self.own)

    @property
    def harmonic_count(self):
        """Number of coefficients of the harmonics per axis."""
        return 3 * self.degree + 1 if self.degree else 0

    def names(self):
        """Names of all terms, for users and the result."""
        return [*self.terms, *([self._series] if self.degree else [])]

    @property
    def _series(self):
        return f'sh{self.degree}' + 'p' * (self.interpretation == 'printed')

    def columns(self, context, run=None):
        """First-order design columns.

        Parameters
        ----------
        context : Context
        run : ndarray of int, shape (n,), optional
            Run index of each row, required with `own` terms.

        Returns
        -------
        GroupColumns
        """
        common = self.common
        az, el, mount = context.az, context.el, context.mount
        rows = [stacked_design(common, az, el, mount)]
        count = self.harmonic_count
        if count:
            functions = basis(az, el, self.interpretation)[:, :count].T
            nothing = np.zeros_like(functions)
            rows += [np.hstack((functions * sky_factor(el, self.interpretation), nothing)),
                     np.hstack((nothing, functions))]
        zeros = [common.index(t) for t in mount.names.index if t in common]
        if not self.own:
            return GroupColumns.alone(np.vstack(rows), zeros)
        return GroupColumns.of(np.tile(run, 2), stacked_design(self.own, az, el, mount),
                               np.vstack(rows), zeros)


def determined_base(obs, base):
    """The base without the terms held at zero because the stars do not determine them.

    Parameters
    ----------
    obs : Observations
    base : Base

    Returns
    -------
    base : Base
    fit : FitResult or None
        Fit that shows this; None if nothing is undetermined.
    """
    if base.degree or not base.terms:
        return base, None
    try:
        fit = fit_terms(obs.run, base.terms, encoder=obs.encoder, run_zeros=bool(base.own))
    except ValueError:  # the fit of the base will report the reason
        return base, None
    if not fit.undetermined:
        return base, None
    held = fit.model.held
    return replace(base, terms=tuple(t for t in base.terms if t not in held),
                   own=tuple(t for t in base.own if t not in held)), fit
