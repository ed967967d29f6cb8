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

"""Cramer-Rao bound of an absolute encoder, and the steps from the paper's fit to the template.

Parts bound, ladder and cut of `absolute_encoder.py`.
"""

from dataclasses import replace

import numpy as np
from encoder_frames import DISCS, SHADING, SHIFTED, TURN, Source, rms, row

from encoder_reading.disc import INVERSION, WINDOW
from encoder_reading.paper_reader import PaperReader, sine_start
from encoder_reading.template_reader import TemplateReader
from msg_tools.units import ARCSEC, wrap
from telescope_mount.papers.indexing_table import SCALES

# --- the bound ------------------------------------------------------------------------------------


def bound(source, angles):
    """Cramer-Rao bound, averaged over `angles`: with all unknowns, and angle alone; arcsec."""
    p, ccd = source.params, source.ccd
    step = 2.0 * ARCSEC
    along = np.linspace(-1.0, 1.0, p.pixels)
    variance = p.noise**2 + 1.0 / 12.0
    sums = np.zeros(2)
    for i in range(0, len(angles), 64):
        part = angles[i : i + 64]
        light = ccd.light(part).astype(float)
        slope = (ccd.light(part + step).astype(float) - ccd.light(part - step)) / (2 * step)
        ground = np.ones_like(light)
        columns = np.stack([
            slope,
            slope * along,  # scale
            light, ground,  # contrast and level
            light * along, light * along**2,  # shading
        ], axis=2)
        # each to unit length: the unknowns have different units
        size = np.sqrt(np.sum(columns**2, axis=1, keepdims=True))
        columns /= size
        information = columns.transpose(0, 2, 1) @ columns
        inverse = np.linalg.inv(information)[:, 0, 0]
        sums += np.sum(variance / size[:, 0, 0] ** 2 * np.stack([inverse, np.ones_like(inverse)]),
                       axis=1)
    return np.sqrt(sums / len(angles)) / ARCSEC


def part_bound(pitch, sizes, seed):
    source = Source(SCALES[pitch], seed)
    reader = TemplateReader(source.params.design)
    angles = source.rng.uniform(0.0, TURN, sizes['places'])
    full, alone = bound(source, angles)
    square = 0.0
    for angle in angles:
        repeated = np.full(sizes['repeats'], angle)
        square += wrap(reader.read(source.frames(repeated)).angle - angle).var(ddof=1)
    sigma = float(np.sqrt(square / len(angles)) / ARCSEC)
    n = len(angles) * (sizes['repeats'] - 1)
    return [
        row('Cramer-Rao bound, scale, contrast, level and shading unknown', full, '"', digits=4),
        row('Cramer-Rao bound, angle alone unknown', alone, '"', digits=4),
        row(f'noise-only sigma, {n} repeats at {len(angles)} angles', sigma, '"', digits=4),
        row('noise-only sigma / bound', sigma / full, '', at_most=1.10, digits=3,
            note=f'+- {sigma / full / np.sqrt(2 * n):.3f}'),
    ]


# --- the ladder from the paper's method to ours ---------------------------------------------------

def sine_fit(grey, weight, omega, phase, x):
    """Weighted least-squares sine of each row by Gauss-Newton: omega, phase at x = 0."""
    level = (grey * weight).sum(axis=1) / weight.sum(axis=1)
    amplitude = np.full(len(grey), 40.0)
    for _ in range(10):
        argument = omega[:, None] * x + phase[:, None]
        sine, cosine = np.sin(argument), amplitude[:, None] * np.cos(argument)
        columns = np.stack([sine, cosine * x, cosine, np.ones_like(sine)], axis=1)
        rest = grey - amplitude[:, None] * sine - level[:, None]
        normal = (columns * weight[:, None]) @ columns.transpose(0, 2, 1)
        step = np.linalg.solve(normal, columns @ (rest * weight)[:, :, None])[:, :, 0]
        amplitude, omega = amplitude + step[:, 0], omega + step[:, 1]
        phase, level = phase + step[:, 2], level + step[:, 3]
    return omega, phase


def template_fit(source, frames, place):
    """Plain least squares of the rendered image of the disc: angle, scale, contrast, level."""
    ccd, pixels = source.ccd, source.params.pixels
    along = np.linspace(-1.0, 1.0, pixels)
    step = 5.0 * ARCSEC
    for _ in range(5):
        light = ccd.light(place).astype(float)
        slope = (ccd.light(place + step).astype(float) - ccd.light(place - step)) / 10.0
        columns = np.stack([slope, slope * along, light, np.ones_like(light)], axis=1)
        change = np.linalg.solve(columns @ columns.transpose(0, 2, 1),
                                 columns @ (frames - light)[:, :, None])[:, :, 0]
        place = place + change[:, 0] * ARCSEC
    return place


def ladder(source, clean, n):
    """Errors of each step at `n` angles (arcsec), and of the sine's period (pixels).

    `source` renders the frames; `clean` is the same disc without flaws, which is what a template
    of the decoded bars knows of it.
    """
    params, x = source.params, np.arange(float(source.params.pixels))
    paper = PaperReader(params.design)
    template = TemplateReader(params.design)
    middle, pitch = paper.middle, params.bar_pitch
    rank = np.arange(WINDOW)
    found, periods = {}, {}
    for angles, frames in source.batches(n, 64):
        grey = INVERSION - frames.astype(float)
        bars = paper.decode(grey)
        # what the paper rejects, no step is asked
        read = np.isfinite(paper.read(frames).angle)
        grey, bars, angles, frames = grey[read], bars.rows(read), angles[read], frames[read]
        centre = bars.centre[:, :WINDOW]
        (_, omega, phase, _), _ = paper.fit(grey, *sine_start(rank, centre))

        def place(omega, phase, at, first=bars.first, centre=centre):
            """Place at pixel `at`, in bars; which maximum is which bar by the decoded centres."""
            cycles = (omega[:, None] * centre + phase[:, None]) / TURN - 0.25
            number = np.rint(np.mean(cycles - rank, axis=1))
            return first - number + (omega * at + phase) / TURN - 0.25

        steps = {
            'sine, phase at pixel 0 (the paper)': place(omega, phase, 0.0) + middle / pitch,
            'sine, phase at the middle': place(omega, phase, middle)}
        last = bars.centre[np.arange(len(grey)), bars.count - 1]
        low, high = bars.centre[:, 0] - 0.5 * pitch, last + 0.5 * pitch
        inside = (x >= low[:, None]) & (x < high[:, None])
        steps['... and only bars that are read'] = place(
            *sine_fit(grey, inside * 1.0, omega, phase, x), middle)
        low = np.where(low < -0.5, low + pitch, low)
        high = np.where(high > x[-1] + 0.5, high - pitch, high)
        inside = (x >= low[:, None]) & (x < high[:, None])
        whole = sine_fit(grey, inside * 1.0, omega, phase, x)
        steps['... and only whole periods of them'] = place(*whole, middle)
        for name, value in (('whole row', omega), ('whole periods', whole[0])):
            periods.setdefault(name, []).append(TURN / value - pitch)
        shown = template_fit(clean, frames, steps['sine, phase at the middle']
                             * source.disc.bar_angle)
        steps['template of the decoded bars'] = shown / source.disc.bar_angle
        steps['robust template (ours)'] = template.read(frames).angle / source.disc.bar_angle
        for name, value in steps.items():
            error = wrap(value * source.disc.bar_angle - angles) / ARCSEC
            found.setdefault(name, []).append(error)
    return ({name: np.concatenate(parts) for name, parts in found.items()},
            {name: np.concatenate(parts) for name, parts in periods.items()})


def part_ladder(pitch, sizes, seed):
    out = []
    quiet = SCALES[pitch]
    for title, params in (
            ('', quiet), ('no noise: ', replace(quiet, noise=0.0)),
            ('shading: ', replace(quiet, **SHADING)),
            ('noise 10: ', replace(quiet, noise=10.0)),
            ('10 % shifted: ', replace(quiet, **SHIFTED))):
        parts = [ladder(Source(params, seed + disc), Source(quiet, seed), sizes['ladder'] // DISCS)
                 for disc in range(DISCS)]
        for name in parts[0][0]:
            error = np.concatenate([part[0][name] for part in parts])
            read = error[np.isfinite(error)]
            usual = read[np.abs(read) < 600.0]
            counts = {'rejected': len(error) - len(read), 'one bar off': len(read) - len(usual)}
            note = ', '.join(f'{count} {what}' for what, count in counts.items() if count)
            out.append(row(title + name, rms(usual), '"', digits=3,
                           note=f'of {len(error)}: {note}' if note else ''))
        if params.noise < 3.0 and params.shifted_bars == 0.0:
            for name in parts[0][1]:
                error = np.concatenate([part[1][name] for part in parts])
                out.append(row(f"{title}error of the sine's period, {name}", rms(error), ' px',
                               digits=4))
    return out


def part_cut(pitch, sizes, seed):
    """How much of the sine's bias the bars at the two ends of the row explain."""
    source = Source(replace(SCALES[pitch], noise=0.0), seed)
    disc, paper = source.disc, PaperReader(source.params.design, cycle='centres')
    angles = source.rng.uniform(0.0, TURN, 3 * sizes['ladder'])
    error = np.concatenate([
        wrap(paper.read(source.ccd.light(part)).angle - part) / ARCSEC
        for part in np.array_split(angles, len(angles) // 256)])
    angles, error = angles[np.isfinite(error)], error[np.isfinite(error)]
    half = 0.5 * source.params.pixels / pitch
    ends = angles / disc.bar_angle + np.array([[-half], [half]])
    nearest = np.rint(ends).astype(int)
    left, right = disc.bits[nearest % disc.bars].astype(int)
    # where the left end lies in its bar period, in 16 parts (the right end lies alike)
    place = ((ends[0] - nearest[0] + 0.5) * 16).astype(int).clip(0, 15)

    def within(group):
        sums, counts = np.bincount(group, error), np.bincount(group)
        return rms(error - (sums / np.maximum(counts, 1))[group])

    return [
        row("the sine's bias, no noise or rounding", within(0 * place), '"'),
        row('... among rows that cut their bars at the same place', within(place), '"'),
        row('... and cut a bar of the same kind at the left', within(16 * left + place), '"'),
        row('... and at the right', within(16 * (2 * left + right) + place), '"'),
    ]
