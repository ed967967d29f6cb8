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

"""A model file as the base of a fit: its terms are refitted, everything else is held fixed."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from .finding import Finding


@dataclass(frozen=True)
class BaseModel:
    """The base of a fit, declared by a model file.

    The terms are refitted to the run, and shown together with their values in the file. Harmonics
    and effects of the file, which no list of terms can declare, are held fixed: subtracted from the
    readings before the fit, and added to the saved model.

    Attributes
    ----------
    path : Path
    model : PointingModel
        The model of the file.
    notes : list of str or Finding
    """

    path: Path
    model: object
    notes: list

    @classmethod
    def read(cls, path, mount):
        """Read a model file of this project or of another program.

        Parameters
        ----------
        path : str or Path
        mount : Mount
            Mount of the run.

        Raises
        ------
        ValueError
            It is no model file, declares no term, or is of another mount.
        """
        from pointing_model.mounts import mount_wording
        from pointing_model.runs.model_reader import read_model
        loaded = read_model(path, mount)
        if not loaded.model.mount.agrees(mount):
            raise ValueError(f'{path} is a model of another mount '
                             f'({mount_wording(loaded.model.mount)}) than the run '
                             f'({mount_wording(mount)})')
        if not loaded.model.terms:
            raise ValueError(f'{path} has no term to fit anew')
        out = cls(Path(path), loaded.model, list(loaded.notes))
        if out.held is not None:
            out.notes.append(Finding('held model', causes=tuple(out._held()),
                                     evidence={'file': str(path)}))
        return out

    @property
    def terms(self):
        """Names of the declared terms."""
        return tuple(self.model.terms)

    @property
    def held(self):
        """Model of the held harmonics and effects, or None."""
        if not self.model.effects and self.model.harmonics is None:
            return None
        return replace(self.model, terms={}, covariance=None, geometry='rotation',
                       provenance={'source': str(self.path)})

    def _held(self):
        series = [] if self.model.harmonics is None else ['harmonics']
        return [*series, *(e.effect.name for e in self.model.effects)]

    def matched(self, run):
        """The run, with a mount whose `errors` (of its parts, or on the sky) are the model's."""
        if self.model.mount.errors == run.mount.errors:
            return run
        from .sky_model import with_errors
        return with_errors(run, self.model.mount.errors)

    def taken_off(self, run, encoder='enc'):
        """The run with the held model subtracted from its readings.

        Parameters
        ----------
        run : PointingRun
        encoder : {'enc', 'abs'}

        Returns
        -------
        PointingRun
        """
        held = self.held
        if held is None:
            return run
        from pointing_model.context import Context
        from pointing_model.runs.run import PointingRun
        context = Context.from_run(run, encoder)
        x, y = held.offsets(run['az'], run['el'], context)
        columns = dict(run.columns)
        az, el = f'az_{encoder}', f'el_{encoder}'
        # errors of the graduation depend on the original reading
        for axis in ('az', 'el'):
            reading = context.get(f'reading_{axis}')
            if encoder == 'enc' and reading is not None:
                columns.setdefault(f'{axis}_raw', reading)
        columns[az] = columns[az] - x / np.cos(run['el'])
        columns[el] = columns[el] - y
        return PointingRun(columns, run.meta)

    def whole(self, model):
        """A model fitted to runs of `taken_off`, with the held model added."""
        held = self.held
        if held is None:
            return model
        if held.harmonics is not None and model.harmonics is not None:
            raise ValueError(f'{self.path} has harmonics, and others were fitted: leave one out')
        return replace(model, harmonics=model.harmonics or held.harmonics,
                       effects=(*model.effects, *held.effects))

    def compared(self, model):
        """Terms of the file and of the fit.

        Parameters
        ----------
        model : PointingModel
            The fitted model.

        Returns
        -------
        dict
            JSON-ready, arcsec: ``terms`` (``here_arcsec``: None if not fitted; ``in_sigma``: the
            difference over both errors, or the fit's alone if the file has none) and ``held``.
        """
        from msg_tools.units import ARCSEC
        sigma, errors = (dict(zip(one.terms, one.sigmas)) for one in (model, self.model))
        rows = []
        for name, there in self.model.terms.items():
            row = {'name': name, 'there_arcsec': there / ARCSEC, 'here_arcsec': None,
                   'sigma_arcsec': None, 'in_sigma': None}
            if name in model.terms:
                error = float(np.hypot(sigma[name], errors[name]))
                row |= {'here_arcsec': model.terms[name] / ARCSEC,
                        'sigma_arcsec': (float(sigma[name]) / ARCSEC
                                         if np.isfinite(sigma[name]) else None),
                        'in_sigma': (model.terms[name] - there) / error if error > 0.0 else None}
            rows.append(row)
        return {'file': str(self.path), 'terms': rows, 'held': self._held()}
