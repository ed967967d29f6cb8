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

"""Errata of both papers: computes the figures of docs/papers.md that have no table elsewhere.

    python benchmarks/papers.py            # a tenth of it, seconds
    python benchmarks/papers.py --full     # 10 000 angles, 2000 skies: a minute

Without ROS. Each figure is printed with the paper's. `test/telescope_mount/papers/test_errata.py`
checks them at a small size.
"""

import argparse
import dataclasses
from importlib import resources

import numpy as np

from calibration.analysis.external_check import split_half
from calibration.analysis.term_fit import fit_harmonics, fit_terms
from encoder_reading.disc import INVERSION
from encoder_reading.paper_reader import THRESHOLD, WIDTH_THRESHOLD, PaperReader
from encoder_reading.template_reader import TemplateReader
from encoder_sim.ccd import LinearCCD
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.harmonics import INTERPRETATIONS, basis, sky_factor
from pointing_model.model import PointingModel
from pointing_model.pointing_terms import design
from pointing_model.rms import rms_arcsec
from pointing_model.runs.run import PointingRun
from pointing_model.runs.run_reader import read_run
from telescope_mount.papers.indexing_table import SCALES
from telescope_mount.papers.table_1 import PAPER_TABLE_1

MMT = resources.files('calibration') / 'data' / 'mmt_2021-08-21.csv'
GROSS = 600.0  # arcsec: half a bar
_BLOCK = 500  # images at once

# --- paper 000 ------------------------------------------------------------------------------------


def evenly(n, lowest, rng):
    """Azimuth and elevation of places spread evenly over the sky above `lowest` degrees."""
    return (rng.uniform(0.0, 2.0 * np.pi, n),
            np.arcsin(rng.uniform(np.sin(lowest * DEG), 1.0, n)))


def left_over(functions, values):
    """Fraction of the norm of `values` that `functions` cannot represent."""
    rest = values - functions @ np.linalg.lstsq(functions, values, rcond=None)[0]
    return np.linalg.norm(rest) / np.linalg.norm(values)


def terms_left(interpretation, lowest=15.0, n=20000, seed=1):
    """Percentage of each term that 13 harmonics per axis cannot represent, by (term, axis)."""
    az, el = evenly(n, lowest, np.random.default_rng(seed))
    functions = basis(az, el, interpretation)
    on_sky = functions * sky_factor(el, interpretation)[:, np.newaxis]
    out = {}
    for name in ('CA', 'NPAE', 'IA', 'AN', 'HASA2', 'IE', 'TF'):
        for axis, held, column in zip(('az', 'el'), (on_sky, functions), design([name], az, el)):
            if column.any():
                out[name, axis] = 100.0 * left_over(held, column[:, 0])
    return out


def conditions(lowest, skies, seed=3):
    """Condition number of eq. 8 for 30 stars at random, zenith reading, shape (skies,)."""
    rng = np.random.default_rng(seed)
    return np.array([np.linalg.cond(basis(*evenly(30, lowest, rng))) for _ in range(skies)])


def tilt_left(interpretation, tilted, stars=60, fits=100, seed=33):
    """Radial RMS residual of harmonics alone on other stars, arcsec: median of `fits`.

    The mount has CA, NPAE, TF and, if `tilted`, an azimuth axis that leans by 43"; stars above 20°
    have 1" of noise an axis.
    """
    rng = np.random.default_rng(seed)
    terms = {'CA': 46.0, 'NPAE': -23.0, 'TF': 15.0, **({'AN': 37.0, 'AW': -21.0} if tilted else {})}
    mount = PointingModel({name: value * ARCSEC for name, value in terms.items()})

    def observed(n):
        az, el = evenly(n, 20.0, rng)
        x, y = np.array(mount.offsets(az, el)) + rng.normal(size=(2, n)) * ARCSEC
        return PointingRun({'az': az, 'el': el, 'az_enc': az + x / np.cos(el), 'el_enc': el + y})

    return np.median([rms_arcsec(*fit_harmonics(observed(stars), interpretation).model.residuals(
        observed(200))).radial for _ in range(fits)])


def mmt_left(fitted, splits=20):
    """Radial RMS residual of models on the held-out half of the MMT night, arcsec.

    Parameters
    ----------
    fitted : callable
        ``fitted(run)`` gives a PointingModel.
    splits : int
    """
    run, left = read_run(MMT), []
    for seed in range(splits):
        used = split_half(run, seed)
        for half in (used, ~used):
            left.append(fitted(run.select(half)).residuals(run.select(~half)))
    return rms_arcsec(*np.concatenate(left, axis=1)).radial


def index_terms(run):
    """Design of IA and IE only."""
    return fit_terms(run, ('IA', 'IE')).model


def best_split(values):
    """Sum of squares within two groups over the whole one, of the best split with two in each.

    Parameters
    ----------
    values : ndarray, shape (..., n)
    """
    values = np.sort(values, axis=-1)

    def squares(part):
        return np.sum((part - part.mean(axis=-1, keepdims=True)) ** 2, axis=-1)

    return np.min([squares(values[..., :k]) + squares(values[..., k:])
                   for k in range(2, values.shape[-1] - 1)], axis=0) / squares(values)


def chance_of_groups(column, draws, seed=5, looked_at=1):
    """How often 11 numbers from a normal and from a uniform distribution split as cleanly.

    With `looked_at` columns: how often the cleanest of so many does, which were all looked at
    before this one was told of (the table has four: azimuth and elevation, before and after).
    """
    printed = best_split(np.array([row[column] for row in PAPER_TABLE_1]))
    rng = np.random.default_rng(seed)
    return tuple(float(np.mean(best_split(draw(size=(draws, looked_at, 11))).min(axis=1)
                               <= printed)) for draw in (rng.normal, rng.uniform))


# --- paper 001 ------------------------------------------------------------------------------------


def image_errors(readers, scale, n, seed=12, **changes):
    """Errors of readers at random angles, and fit statistics of the first.

    Parameters
    ----------
    readers : list
    scale : {48, 60}
        Pixels a bar.
    n : int
    changes
        Of the CCD's parameters.

    Returns
    -------
    errors : ndarray, shape (readers, n)
        arcsec; NaN where rejected.
    r_square, period : ndarray, shape (n,)
        Of the first reader, a `PaperReader`.
    """
    params = dataclasses.replace(SCALES[scale], **changes)
    camera, rng = LinearCCD(params, params.design.disc, 1), np.random.default_rng(seed)
    errors, r_square, period = [], [], []
    for start in range(0, n, _BLOCK):
        angles = rng.uniform(0.0, 2.0 * np.pi, min(_BLOCK, n - start))
        noise = rng.standard_normal((len(angles), params.pixels))
        images = camera.render(angles, noise)
        reads = [reader.read(images) for reader in readers]
        errors.append([wrap(read.angle - angles) / ARCSEC for read in reads])
        r_square.append(reads[0].r_square)
        period.append(reads[0].period)
    return np.concatenate(errors, axis=1), np.concatenate(r_square), np.concatenate(period)


def paper_readers(scale):
    """The paper's reader with its bar found by the centres, by eq. 12; and the one that ships."""
    design_ = SCALES[scale].design
    return [PaperReader(design_, cycle='centres'), PaperReader(design_), TemplateReader(design_)]


def repeated_scatter(scale, n=500):
    """Standard deviation of the paper's repeated reading at one angle, arcsec."""
    params, rng = SCALES[scale], np.random.default_rng(4)
    images = LinearCCD(params, params.design.disc, 1).render(
        np.full(n, 1.234), rng.standard_normal((n, params.pixels)))
    reader = PaperReader(params.design, cycle='centres')
    return np.std(wrap(reader.read(images).angle - 1.234) / ARCSEC)


def bars_seen(scale):
    """Widths and integrated grey levels of wide and of narrow bars without noise.

    Returns
    -------
    dict of str to tuple
        ``wide`` and ``narrow``: mean width (pixels), least and largest integrated grey level.
    """
    params = SCALES[scale]
    grey = INVERSION - LinearCCD(params, params.design.disc, 1).light(np.linspace(0, 6.2, 40))
    widths, totals = [], []
    for row in grey:
        steps = np.flatnonzero(np.diff(np.r_[0, row > THRESHOLD, 0]))
        for start, end in zip(steps[2:-2:2], steps[3:-2:2]):
            widths.append(end - start)
            totals.append(row[start:end].sum())
    widths, totals = np.array(widths), np.array(totals)
    wide = totals > WIDTH_THRESHOLD
    return {name: (widths[some].mean(), totals[some].min(), totals[some].max())
            for name, some in (('wide', wide), ('narrow', ~wide))}


# --- the table ------------------------------------------------------------------------------------


def row(erratum, what, here, paper=''):
    """Print a line of the table."""
    print(f'{erratum:>3}  {what:62} {here:32} {paper}')


def paper_000(part):
    """Lines of paper 000; `part` of the full size."""
    for reading in INTERPRETATIONS:
        left = terms_left(reading)
        row('1', f'percent of a term left, {reading}',
            ' '.join(f'{name} {axis} {value:.1f}' for (name, axis), value in left.items()))
    for name, before in (('alone', lambda run: None), ('after IA, IE', index_terms),
                         ('after 7 terms', lambda run: fit_terms(run).model)):
        for reading in INTERPRETATIONS:
            left = mmt_left(lambda run, r=reading, b=before: fit_harmonics(
                run, r, held=b(run)).model)
            row('1', f'MMT night, other half, 13 harmonics {name}, {reading}', f'{left:.2f}"')
    seven = mmt_left(lambda run: fit_terms(run).model)
    row('1', 'MMT night, other half, 7 terms', f'{seven:.2f}"')
    for lowest in (15.0, 20.0):
        low, middle, high = np.quantile(conditions(lowest, int(2000 * part)), (0.05, 0.5, 0.95))
        row('3', f'condition, 30 stars at random above {lowest:g}°: median, 5 and 95 %',
            f'{middle:.0f} ({low:.0f} to {high:.0f})')
    for stars in (60, 400):
        for reading in INTERPRETATIONS:
            left = [tilt_left(reading, tilted, stars, int(100 * part)) for tilted in (True, False)]
            row('3', f'{stars} stars, harmonics alone, {reading}: 43" of tilt; none',
                '; '.join(f'{value:.2f}"' for value in left))
    for column in ('after_az_arcsec', 'after_el_arcsec'):
        for looked_at, words in ((1, ''), (4, ', of four columns')):
            normal, even = chance_of_groups(column, int(200_000 * part), looked_at=looked_at)
            row('5', f'chance of two groups, {column}{words}: normal, even',
                f'{normal:.5f}, {even:.5f}', 'stable')


def paper_001(part):
    """Lines of paper 001."""
    n = int(10_000 * part)
    for scale in SCALES:
        seen = bars_seen(scale)
        for name, paper in (('wide', '25'), ('narrow', '9')):
            width, low, high = seen[name]
            row('9', f'{scale} px a bar: {name} bars, pixels, integrated grey',
                f'{width:.1f}, {low:.0f} to {high:.0f}', f'about {paper}; threshold 3000')
        errors, r_square, period = image_errors(paper_readers(scale), scale, n)
        off = np.count_nonzero(np.abs(errors) > GROSS, axis=1)
        row('10', f'{scale} px: readings one bar off, eq. 12; by centres',
            f'{off[1]} of {n}; {off[0]}')
        row('11', f'{scale} px: std of the sine; of the template',
            f'{np.nanstd(errors[0]):.2f}"; {np.nanstd(errors[2]):.2f}"', '4.57"')
        quiet, _, _ = image_errors(paper_readers(scale)[:1], scale, n, noise=0.0)
        row('11', f'{scale} px: std of the sine without noise; repeated at one angle',
            f'{np.nanstd(quiet[0]):.2f}"; {repeated_scatter(scale):.2f}"')
        moved, _, _ = image_errors(paper_readers(scale), scale, n, shifted_bars=0.1)
        row('11', f'{scale} px: 10 % of the bars displaced: sine; template',
            f'{np.nanstd(moved[0]):.1f}"; {np.nanstd(moved[2]):.2f}"', 'almost unaffected')
        loud = image_errors(paper_readers(scale)[:1], scale, n, noise=10.0)[1]
        row('17', f'{scale} px: R-square, noise 2; 10',
            f'{np.nanmedian(r_square):.3f}; {np.nanmedian(loud):.3f}', '0.6 to 0.7')
        row('17', f'{scale} px: period - pitch, RMS', f'{np.nanstd(period - scale):.4f} px',
            'within 0.005 px')


def main():
    """Print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--full', action='store_true', help='the sizes of docs/papers.md')
    part = 1.0 if parser.parse_args().full else 0.1
    row('', '', 'here', 'the paper')
    paper_000(part)
    paper_001(part)


if __name__ == '__main__':
    main()
