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

"""Read model files: documents of this project, tables and files of other programs."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from msg_tools.units import DEG
from pointing_model.model import PointingModel
from pointing_model.model_document import FORMAT
from pointing_model.mounts import ALTAZ, mount_wording

from .model_files import coefficient_table
from .model_files.transfer import imported, program_for
from .programs import PROGRAMS

#: ``ImportedModel.program`` of a document of this project
OURS = 'telescope_mount'
#: rad: largest zero offset (any within a turn is possible), and largest of the other terms
_LARGEST_INDEX, _LARGEST = 2.0 * np.pi, 0.35
_SUFFIXES = ('.json', '.yaml', '.yml')


@dataclass
class ImportedModel:
    """A model that was read.

    Attributes
    ----------
    model : PointingModel
    program : str
        `OURS`, ``table`` or a name of `PROGRAMS`.
    notes : list of str
        Remarks for the user.
    """

    model: PointingModel
    program: str
    notes: list = field(default_factory=list)


def is_ours(path):
    """Whether a file is a model of this project; a YAML file only if its content shows it."""
    return path.suffix.lower() == '.json' or (
        path.suffix.lower() in _SUFFIXES and path.is_file()
        and FORMAT in path.read_text(encoding='utf-8', errors='replace'))


def _refuse_unit(path, program, model):
    """Refuse terms too large for any mount: they are not in the program's unit."""
    index = model.mount.names.index
    for name, value in model.terms.items():
        if not abs(value) <= (_LARGEST_INDEX if name in index else _LARGEST):
            raise ValueError(f'{path}: {name} would be {value / DEG:.4g} deg, which no mount has: '
                             f'are these numbers in arcsec, and not as {program.title} has them?')


def read_model(path, mount=ALTAZ):
    """Read a model file of ours or of another program, recognised by its content.

    Parameters
    ----------
    path : str or Path
    mount : Mount, optional
        Mount of the model; files of this project name their own.

    Returns
    -------
    ImportedModel

    Raises
    ------
    ValueError
        Unknown terms, numbers that are not finite, another mount, or not a model file. One line.
    OSError
        The file cannot be read.
    """
    path = Path(path)
    if path.suffix.lower() in _SUFFIXES:
        model = PointingModel.load(path)
        if not mount.vertical and not model.mount.agrees(mount):
            raise ValueError(f'{path} is a model of another mount ({mount_wording(model.mount)}) '
                             f'than the given one ({mount_wording(mount)})')
        return ImportedModel(model, OURS)
    data = path.read_bytes()
    if not data.strip():
        raise ValueError(f'{path} is empty')
    text = data.decode('utf-8-sig', errors='replace').replace('\r\n', '\n')
    if coefficient_table.looks_like(text):
        return ImportedModel(coefficient_table.read(path, text, mount), coefficient_table.NAME)
    for program in PROGRAMS.values():
        if program.looks_like(text):
            program = program_for(program, mount)
            found = program.read(path, text)
            model, loss = imported(program, found, path)
            _refuse_unit(path, program, model)
            notes = list(found.notes)
            if loss is not None and loss.largest > 1e-3:
                notes.append(f'it differs from {program.title} by {loss.rms:.3f} arcsec RMS, '
                             f'at most {loss.largest:.3f}, on a uniform sky above 20 degrees')
            return ImportedModel(model, program.name, notes)
    raise ValueError(f'{path} is no model file: expected .json or .yaml of this program, a table '
                     'with name and value_arcsec, or one of ' + ', '.join(
                         p.title for p in PROGRAMS.values()))
