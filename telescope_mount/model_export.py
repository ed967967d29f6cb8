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

"""Export of a model to another program: the file, its content, and the loss on the sky of a run."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calibration.analysis.fit_result import undetermined_terms
from calibration.report.terminal_tables import new_table
from calibration.report.wording import wording
from msg_tools.units import ARCSEC
from msg_tools.whole_files import write_text
from pointing_model.context import Context
from pointing_model.effects.base import driver_word, readable
from pointing_model.model_application import zeros_of_rows
from pointing_model.mounts import ALTAZ
from pointing_model.rms import rms_arcsec
from pointing_model.runs.model_files import coefficient_table
from pointing_model.runs.model_files.transfer import export, program_for
from pointing_model.runs.model_reader import read_model
from pointing_model.runs.programs import PROGRAMS
from pointing_model.runs.programs.katpoint import description
from pointing_model.zero import OF_RUNS, carried_zeros

from .commands.console import print_all, print_files, print_lines
from .input_files.run_loader import load_run

#: ``--to``: our own format
MODEL = 'model'


@dataclass
class ModelExport:
    """Result of an export.

    Attributes
    ----------
    path : Path
    program : str
    exported : pointing_model.runs.model_files.Exported or None
        None if nothing can be lost: for our own format, and for the table.
    notes : list of str
    """

    path: Path
    program: str
    exported: object
    notes: list

    def to_dict(self):
        """JSON-ready."""
        exported = self.exported.to_dict() if self.exported else {}
        return {'program': self.program, 'held': True, **exported, 'file': str(self.path),
                'notes': self.notes}


#: number of parts of a model without a term there that are listed
_PARTS = 12


def export_model(source, path, to, *, sky=None, zero='none', site=None, mount=None,
                 side=None, **options):
    """Write a model in the format of another program.

    Parameters
    ----------
    source : str or Path
        Any file that `pointing_model.runs.model_files.read_model` reads.
    path : str or Path
    to : str
        A key of `commands.export.PROGRAMS`.
    sky : str or Path, optional
        A run: what the program cannot represent is refitted on its directions and drivers, and
        the loss is reported for them. By default the sky above 20 degrees.
    zero : {'none', 'newest'} or number
        Which of the zeros stored in the model to add to its index terms.
    site : pointing_model.sky.site.Site, or dict with ``latitude``, optional
        By default that of the run, if it has one. INDI needs it.
    mount : Mount, optional
        Mount for a file of another program; by default an alt-azimuth one.
    side : {'east', 'west'}, optional
        Side of the pier, for a German mount and a program whose file has none; by default that of
        the fitted rows, if all are on one side.
    **options
        See `telescope_mount.input_files.run_loader.load_run`.

    Returns
    -------
    ModelExport

    Raises
    ------
    ValueError
        `source` is not a model, or `path` has the suffix of another kind.
    OSError
        A file cannot be read or written.
    """
    source, path = Path(source), Path(path)
    ours = path.suffix.lower() in ('.json', '.yaml', '.yml')
    if ours is not (to == MODEL):
        raise ValueError(f'{path}: .json and .yaml are the suffixes of --to {MODEL} '
                         'and of no other program')
    loaded = read_model(source, mount or ALTAZ)
    model, remarks = _with_zero(loaded.model, zero)
    notes = [*loaded.notes, *remarks, *_open_notes(model)]
    if to == MODEL:
        model.save(path)
        return ModelExport(path, to, None, notes)
    facts = {'caption': f'telescope_mount, {source.name}'}
    if to == coefficient_table.NAME:
        write_text(path, coefficient_table.write(model, facts['caption']))
        return ModelExport(path, to, None, notes)
    context, place = None, ''
    if sky is not None:
        context, place, more = _sky_of(sky, model, {**options, 'mount': mount, 'site': site})
        facts |= more
    if hasattr(site, 'longitude'):
        facts['site'] = site.latitude, site.longitude
    beyond, more = _beyond(model, PROGRAMS[to], side)
    exported = export(model, PROGRAMS[to], context, place, facts, beyond)
    write_text(path, exported.text)
    return ModelExport(path, to, exported, [*notes, *more, *exported.notes])


def _beyond(model, program, side):
    """Side of the pier for a file without sides, and notes on it."""
    mount = model.mount
    if not (mount.two_sided and program_for(program, mount).one_sided):
        if side:
            raise ValueError(f'--side {side}: does not apply to {program.title} models of this '
                             'mount; leave it out')
        return None, []
    if side is None and model.sides is not None and 0 in model.sides:
        side = 'east' if model.sides[0] else 'west'
    if side:
        return side == 'west', [f'the file is valid on the {side} side of the pier only: '
                                'load another file on the other side']
    if mount.on_sky:
        return None, []
    # terms whose effect changes with the side, and are not zero
    large = {name: f'{name} is {value / ARCSEC:+.1f} +- {error / ARCSEC:.1f} arcsec'
             for (name, value), error in zip(model.terms.items(), model.sigmas)
             if name in ('CH', 'NP', 'ID') and not abs(value) <= error}
    zero = large.pop('ID', '')
    if large:
        raise ValueError(
            f'{program.title} models have no pier side, one CH and no NP, but here '
            f'{", ".join(large.values())}. Write one file per side (--side east, --side west), '
            'or correct with the INDI bridge of telescope-mount (docs/indi.md)')
    return None, ['valid on both pier sides: CH and NP are within one sigma of zero' + (
        f'; {zero}, which changes with the side too: set that zero on a star' if zero else '')]


def _open_notes(model):
    """Notes on undetermined terms and sides, which no file of another program has."""
    notes = [wording(undetermined_terms(model.undetermined, model.terms))] \
        if model.undetermined else []
    if model.sides is not None and 0 in model.sides:
        notes.append('all rows of the fit are on one side of the pier: the model is untested '
                     'on the other')
    return notes


def _with_zero(model, wanted):
    """The model with a zero added to its index terms, and notes on it."""
    (az, el), applied = zeros_of_rows(model, wanted)
    known = carried_zeros(model)
    if not applied:
        if not known or not known.newest.angles.any():  # or it is in the index terms
            return model, []
        newest = known.newest
        return model, [f'the zero of the power-on is not in the file (run {newest.run:g}, azimuth '
                       f'{newest.az / ARCSEC:+.2f}, elevation {newest.el / ARCSEC:+.2f} arcsec); '
                       '--zero newest adds it to the index terms']
    covariance = model.covariance
    terms = {**model.terms}
    for name, value in zip(model.mount.names.index, (az, el)):
        if name not in terms:
            covariance = np.pad(covariance, (0, 1))
        terms[name] = terms.get(name, 0.0) + value
    # it is now in the index terms, so the model has no separate zero
    provenance = {k: v for k, v in model.provenance.items()
                  if k not in ('zeros_in_force', OF_RUNS)}
    return replace(model, terms=terms, covariance=covariance, provenance=provenance), [
        f'the zero of run {applied[0].run:g} was added to the index terms: azimuth '
        f'{az / ARCSEC:+.2f}, elevation {el / ARCSEC:+.2f} arcsec']


def _sky_of(path, model, options):
    """Context of a run's rows, its description, and facts of the run for the file."""
    run = load_run(path, **options)
    if not run.mount.agrees(model.mount):
        raise ValueError(f'{path} is a run of another mount ({run.mount.kind}) than the model '
                         f'({model.mount.kind}), or of another latitude')
    x, y = model.residuals(run)
    # the median is the zero of the run, if that differs from the model's
    left = rms_arcsec(x - np.nanmedian(x), y - np.nanmedian(y))
    context = Context.from_run(run)
    facts = {'observations': len(run), 'rms_arcsec': left.radial}
    if None not in (context.latitude, context.longitude):
        facts['site'] = context.latitude, context.longitude
    return context, f'the {len(run)} directions of {Path(path).name}', facts


def show(written, console):
    """Print the terms in the file, and the loss."""
    exported = written.exported
    if exported is not None:
        program = exported.program
        table = new_table(f'Terms of {program.title}', 'term', 'value', 'unit')
        for name, value, unit in exported.listed():
            table.add_row(name, f'{value:+.4f}' if unit else f'{value:+.6g}', unit)
        console.print(table)
        print_all(console, sentences(exported))
        if program.name == 'katpoint':
            console.print(f'description: {description(exported.terms)}', soft_wrap=True)
    print_lines(console, 'note', written.notes)
    print_files(console, {written.program: written.path})


def sentences(exported):
    """Sentences on how well a program represents a model."""
    program, loss, direct = exported.program, exported.loss, exported.direct
    where = f'on {exported.sky}'
    if exported.held:
        return [f'{program.title} reproduces the model within {max(loss.largest, 1e-4):.4f} '
                f'arcsec {where}']
    lines = []
    if exported.left:
        parts = list(dict.fromkeys(map(_part, exported.left)))
        # a model for prediction has dozens
        more = [f'{len(parts) - _PARTS} more'] if len(parts) > _PARTS else []
        lines.append(f'{program.title} has no term for: '
                     f'{"; ".join([*parts[:_PARTS], *more])}')
    if exported.refitted:
        lines.append('terms refitted for it; copied by name alone they would be off by '
                     f'{direct.rms:.3f} arcsec RMS, at most {direct.largest:.3f}')
    if exported.added:
        lines.append(f'further terms, fitted to what has no term: '
                     f'{", ".join(exported.added)}')
    if exported.left and exported.elsewhere is None:
        lines.append('fitted over the whole sky, also where the model may have no data: '
                     '--sky RUN fits the directions of a run')
    if program.whole:
        lines.append('it takes whole arcseconds')
    lines.append(f'loss: {loss.rms:.3f} arcsec RMS, at most {loss.largest:.3f}, {where}')
    other = exported.elsewhere
    if other is not None:
        lines.append('direction-dependent part, on a uniform sky above 20 degrees: '
                     f'{other.rms:.3f} arcsec RMS, at most {other.largest:.3f}')
    return lines


def _part(text):
    """Name for people of a part of a model that a program cannot represent."""
    name, _, needs = text.removesuffix(')').partition(' (follows ')
    words = dict.fromkeys(map(driver_word, needs.split(', '))) if needs else ()
    return readable(name) + (f' (follows {", ".join(words)})' if words else '')
