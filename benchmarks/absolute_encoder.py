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

"""The absolute encoder: error against the Cramer-Rao bound, gross errors, speed.

    python benchmarks/absolute_encoder.py [--quick] [--pitch 48|60] [--only PART ...] [--seed N]
                                          [--json FILE]

Parts: bound, ladder, cut, total, gross, faces, limits, focus, speed, node. Full size takes some
minutes of one core (100 000 frames for each kind in `gross`), --quick some seconds. All frames are
rendered by `encoder_sim.ccd` with noise of 2 grey levels and rounding to 8 bits unless said, at
random angles of a disc, at both scales that the paper's figures allow (48 and 60 pixels a bar).

The bound is the Cramer-Rao bound of the same image model: derivatives of the rendered image by
the angle and by the unknown scale, contrast, ground level and shading (tilt and falloff of the
illumination), with noise variance sigma^2 + 1/12 for the rounding. It is averaged over the
angles. The bound with the angle as the only unknown is printed too. "Noise-only sigma" is the
scatter of repeated readings at one angle: it contains no bias.

Peers in the same run: the paper's method (`encoder_reading.paper_reader`), its Newton fit alone on
the same batch, vectorised in the same way, and `scipy.optimize.curve_fit` of its sine. Both fits
start from the decoded bars; decoding is not timed. Times are for one thread. Rounds alternate
between the candidates, and the median round is printed as CPU time, which other load on the machine
does not affect.
"""

import argparse
import json
import os
import sys
import time
from dataclasses import replace
from pathlib import Path

for _name in ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS'):
    os.environ[_name] = '1'

import numpy as np  # noqa: E402
from encoder_fits import part_bound, part_cut, part_ladder  # noqa: E402
from encoder_frames import (  # noqa: E402
    DISCS,
    SHADING,
    SHIFTED,
    TURN,
    Source,
    Tally,
    rms,
    row,
)

from encoder_reading.axis_reader import read_frames  # noqa: E402
from encoder_reading.disc import INVERSION, WINDOW  # noqa: E402
from encoder_reading.paper_reader import PaperReader, sine_start  # noqa: E402
from encoder_reading.template_reader import TemplateReader  # noqa: E402
from encoder_sim.absolute import AbsoluteEncoder  # noqa: E402
from encoder_sim.ccd import LinearCCD  # noqa: E402
from msg_tools.units import ARCSEC, wrap  # noqa: E402
from telescope_mount.papers.indexing_table import SCALES, IndexingTable  # noqa: E402

BATCH = 64
STRONG_SHADING = {'shading_tilt': 0.10, 'shading_falloff': 0.30}
MISSING = {'missing_bars': 0.10}
BLOBS = 3


# --- total error and gross errors -----------------------------------------------------------------

def conditions(pitch):
    """Name, parameters and blobs of the clean and the dirty conditions, with shading."""
    shaded = replace(SCALES[pitch], **SHADING)
    return {
        'clean': (shaded, 0),
        '10 % of the bars shifted by 0.15 pitch': (replace(shaded, **SHIFTED), 0),
        '10 % of the bars missing': (replace(shaded, **MISSING), 0),
        'three 60 px blobs': (shaded, BLOBS),
    }


def part_total(pitch, sizes, seed):
    out = []
    for name, (params, blobs) in conditions(pitch).items():
        sources = [Source(params, seed + disc, blobs) for disc in range(DISCS)]
        disc = sources[0].disc
        ours, paper = Tally(disc.bar_angle), Tally(disc.bar_angle)
        template = TemplateReader(params.design)
        sine = PaperReader(params.design, cycle='centres')
        for source in sources:
            for angles, frames in source.batches(sizes['total'] // DISCS):
                ours.add(template.read(frames), angles)
                paper.add(sine.read(frames), angles)
        out.append(row(f'total RMS, shading, {name}', ours.rms, '"', at_most=0.50, digits=3,
                       note=f'largest {ours.largest:.2f}", rejected {ours.rejected}, '
                       f'corrected {ours.corrected} of {ours.n}'))
        out.append(row("    the paper's fit on the same frames", paper.rms, '"', digits=2,
                       note=f'rejected {paper.rejected}, bar taken wrong {paper.gross}'))
    source = Source(replace(SCALES[pitch], **STRONG_SHADING), seed)
    tally = Tally(source.disc.bar_angle)
    template = TemplateReader(source.params.design)
    for angles, frames in source.batches(sizes['total']):
        tally.add(template.read(frames), angles)
    out.append(row('total RMS, 30 % less light at the ends, 10 % of tilt', tally.rms, '"',
                   at_most=0.50, digits=3, note=f'rejected {tally.rejected}'))
    return out


def garbage(source, n):
    """Frames that show nothing of this disc, in equal parts of six kinds."""
    rng, pixels = source.rng, source.params.pixels
    part = [len(a) for a in np.array_split(np.arange(n), 6)]
    x = np.arange(pixels)
    frames = [rng.integers(0, 256, (part[0], pixels))]
    # smooth noise of random correlation length
    smooth = np.cumsum(rng.standard_normal((part[1], pixels)), axis=1)
    width = rng.integers(2, 100, part[1])
    smooth -= np.take_along_axis(smooth, (x - width[:, None]) % pixels, axis=1)
    frames.append(128 + 40 * smooth / np.sqrt(width)[:, None])
    # waves of any period, that of the bars as well
    period = rng.uniform(5.0, 200.0, (part[2], 1))
    period[::2] = source.params.bar_pitch * rng.uniform(0.99, 1.01, (len(period[::2]), 1))
    wave = np.sin(TURN * (x / period + rng.uniform(size=(part[2], 1))))
    frames.append(115 + 44 * wave + 2 * rng.standard_normal(wave.shape))
    # a constant, with noise
    frames.append(rng.uniform(0, 255, (part[3], 1)) + 2 * rng.standard_normal((part[3], pixels)))
    # random telegraph: bars anywhere, of any width
    edges = rng.uniform(size=(part[4], pixels)) < rng.uniform(0.005, 0.1, (part[4], 1))
    frames.append(71 + 88 * (np.cumsum(edges, axis=1) % 2))
    # saturated, dark, not a number
    rest = np.where(rng.uniform(size=(part[5], 1)) < 0.5, 255.0, 0.0) * np.ones(pixels)
    rest[::3, rng.integers(pixels)] = np.nan
    frames.append(rest)
    return [np.clip(f, 0, 255) for f in frames]


def foreign(params, seed, n):
    """Good frames of discs that are not this one: random bits."""
    rng = np.random.default_rng(seed)
    for i in range(0, n, 1000):
        source = Source(replace(params), int(rng.integers(2**31)))
        source.disc.bits = rng.integers(0, 2, source.disc.bars).astype(np.uint8)
        source.ccd = LinearCCD(params, source.disc, 0)
        yield source.random(min(1000, n - i))


def part_gross(pitch, sizes, seed):
    n, out = sizes['gross'], []
    quiet = SCALES[pitch]
    kinds = {'clean': (quiet, 0)}
    kinds |= {k: v for k, v in conditions(pitch).items() if k != 'clean'}
    kinds |= {'noise 5': (replace(quiet, noise=5.0), 0),
              'CCD mounted the other way round': (replace(quiet, mounting='reversed'), 0)}
    for name, (params, blobs) in kinds.items():
        # the dirty kinds share their 100 000
        count = n if name in ('clean', 'noise 5') else -(-n // 3)
        sources = [Source(params, seed + 10 + disc, blobs) for disc in range(DISCS)]
        reader = TemplateReader(quiet.design)
        tally = Tally(reader.disc.bar_angle)
        for source in sources:
            for angles, frames in source.batches(-(-count // DISCS)):
                tally.add(reader.read(frames), angles)
        out.append(row(f'silent gross errors, {name}', tally.gross, f' of {tally.n}', at_most=0,
                       digits=0, note=f'rejected {tally.rejected} '
                       f'({100 * tally.rejected / tally.n:.3f} %), corrected {tally.corrected}'))
        if name == 'clean':
            out.append(row('rejected, clean', 100 * tally.rejected / tally.n, ' %', at_most=0.1,
                           digits=3))
    source = Source(quiet, seed + 2)
    reader = TemplateReader(quiet.design)
    angles, seen = 0, 0
    for i in range(0, n, 6000):
        for frames in garbage(source, min(6000, n - i)):
            angles += int(np.isfinite(reader.read(frames).angle).sum())
            seen += len(frames)
    out.append(row('angles from random garbage', angles, f' of {seen}', at_most=0, digits=0))
    angles, seen = 0, 0
    for _, frames in foreign(quiet, seed + 3, -(-n // 5)):
        angles += int(np.isfinite(reader.read(frames).angle).sum())
        seen += len(frames)
    out.append(row('angles from good frames of other discs', angles, f' of {seen}', at_most=0,
                   digits=0))
    return out


# --- 23 angles, and what no method can remove -----------------------------------------------------

def part_faces(pitch, sizes, seed):
    bench = IndexingTable(SCALES[pitch], seed, ('paper', 'template'))
    errors = bench.turns(sizes['turns'])
    out = []
    for name, target in (('paper', (4.0, 5.0)), ('template', None)):  # the paper: 4.57"
        e = np.where(np.abs(errors[name]) < bench.gross, errors[name], np.nan)
        stds = np.nanstd(e, axis=1, ddof=1) / ARCSEC
        low, high = np.percentile(stds, [5, 95])
        value = float(np.sqrt(np.mean(stds**2)))
        inside = np.mean((stds >= 4.0) & (stds <= 5.0))
        out.append(row(f'std on 23 angles, {name}, {len(stds)} turns', value, '"', digits=2,
                       between=target, note=f'single turns {low:.2f} to {high:.2f}" (90 %), '
                       f'{100 * inside:.0f} % within 4 to 5", one bar off '
                       f'{int((np.abs(errors[name]) >= bench.gross).sum())}'))
    return out


def part_limits(pitch, sizes, seed):
    """What disc and bearing add, whatever the method."""
    out = []
    for size in (0.5, 1.0, 2.0):
        square = []
        for disc in range(DISCS):
            source = Source(replace(SCALES[pitch], bar_position_error=size * 1e-6), seed + disc)
            angles, frames = source.random(sizes['ladder'] // DISCS)
            square.append(np.mean(wrap(
                TemplateReader(source.params.design).read(frames).angle - angles) ** 2))
        out.append(row(f'total RMS, bars {size:g} um (rms) off their places',
                       np.sqrt(np.mean(square)) / ARCSEC, '"', digits=2))
    out.append(row('eccentricity of 1 um, one head: amplitude once a turn',
                   1e-6 / (0.5 * SCALES[pitch].diameter) / ARCSEC, '"', digits=2))
    return out


#: a disc that swings by so much at either side of its focus, at one side of it, or is tilted, and a
#: lamp with so much of its light: name and parameters
IMAGES = (
    *((f'run-out {um:g} um about the focus', {'runout': um * 1e-6}) for um in (20, 100, 200, 300)),
    *((f'run-out {um:g} um from the focus on', {'runout': um * 1e-6, 'focus_error': um * 1e-6})
      for um in (100, 150, 200)),
    *((f'disc tilted by {deg:g} deg', {'tilt': np.deg2rad(deg)}) for deg in (0.1, 0.25, 0.5)),
    *((f'lamp at {left:.0%}', {'lamp_left': left}) for left in (0.5, 0.2, 0.1, 0.07, 0.05)),
)


def part_focus(pitch, sizes, seed):
    """Discs that leave the focus, and lamps that die; what one and two a turn leave."""
    out = []
    for name, flaw in IMAGES:
        device = AbsoluteEncoder(replace(SCALES[pitch], **flaw), seed, 'azimuth')
        n = sizes['ladder']
        angles = np.random.default_rng(seed).uniform(0.0, TURN, n)
        readings = device.read(np.arange(n), angles)
        good = np.isfinite(readings.angle)
        error = wrap(readings.angle - angles)[good] / ARCSEC
        gross = np.abs(error) >= 600.0
        waves = np.stack([np.ones(good.sum()), *(
            f(k * angles[good]) for k in (1, 2) for f in (np.cos, np.sin))], axis=1)
        left, few = error, good.sum() < 10 * waves.shape[1]
        if not few:
            left = error - waves @ np.linalg.lstsq(waves[~gross], error[~gross], rcond=None)[0]
        told = readings.sigma[good] / ARCSEC
        out.append(row(
            f'{name}: RMS beside one and two a turn', np.nan if few else rms(left[~gross]), '"',
            note=f'{np.mean(~good):.1%} of {n} rejected, {gross.sum()} wrong by half a bar'
            + ('' if few else f', sigma told {np.sqrt(np.mean(told**2)):.2f}"')))
    return out


# --- speed ----------------------------------------------------------------------------------------

def time_all(candidates, rounds):
    """CPU time of a call, s, in the median and in the fastest round; the rounds alternate."""
    seconds = {name: [] for name in candidates}
    for i in range(rounds + 1):  # the first round warms up
        for name, (call, calls) in candidates.items():
            start = time.process_time()
            for _ in range(calls):
                call()
            if i:
                seconds[name].append((time.process_time() - start) / calls)
    return ({name: float(np.median(values)) for name, values in seconds.items()},
            {name: min(values) for name, values in seconds.items()})


def part_speed(pitch, sizes, seed):
    from scipy.optimize import curve_fit

    params = SCALES[pitch]
    source = Source(params, seed)
    shifted = Source(replace(params, **SHADING, **SHIFTED), seed).random(BATCH)[1]
    blobs = Source(replace(params, **SHADING), seed, BLOBS).random(BATCH)[1]
    template = TemplateReader(params.design)
    paper = PaperReader(params.design)
    frames = source.random(BATCH)[1]
    grey = INVERSION - frames.astype(float)
    omega, phase = sine_start(np.arange(WINDOW), paper.decode(grey).centre[:, :WINDOW])
    x = np.arange(float(params.pixels))

    def sine(x, a, w, p, n):
        return a * np.sin(w * x + p) + n

    def scipy_fit(i=0):
        start = [40.0, omega[i], phase[i], grey[i].mean()]
        return curve_fit(sine, x, grey[i], start)

    few = max(1, sizes['calls'] // 10)
    median, fastest = time_all({
        'ours, batch': (lambda: template.read(frames), sizes['calls']),
        'ours, batch, shifted': (lambda: template.read(shifted), sizes['calls']),
        'ours, batch, blobs': (lambda: template.read(blobs), sizes['calls']),
        'ours, one frame': (lambda: template.read(frames[:1]), sizes['calls']),
        'newton, batch': (lambda: paper.fit(grey, omega, phase), few),
        'newton, one frame': (lambda: paper.fit(grey[:1], omega[:1], phase[:1]), sizes['calls']),
        'paper, batch': (lambda: paper.read(frames), few),
        'paper, one frame': (lambda: paper.read(frames[:1]), sizes['calls']),
        'curve_fit': (scipy_fit, few),
    }, sizes['rounds'])
    us, best = ({name: 1e6 * value / (BATCH if 'batch' in name else 1)
                 for name, value in seconds.items()} for seconds in (median, fastest))
    batch, single = us['ours, batch'], us['ours, one frame']
    return [
        row(f'decode and fit, batch of {BATCH}, a frame', batch, ' us', at_most=40.0, digits=1,
            note=f'fastest round {best["ours, batch"]:.1f} us'),
        row('... shading, 10 % of the bars shifted', us['ours, batch, shifted'], ' us',
            at_most=40.0, digits=1),
        row('... shading, three 60 px blobs', us['ours, batch, blobs'], ' us', at_most=40.0,
            digits=1),
        row('decode and fit, one frame alone', single, ' us', at_most=250.0, digits=0,
            note=f'fastest round {best["ours, one frame"]:.0f} us'),
        row('curve_fit of the sine (fit only)', us['curve_fit'], ' us', digits=0),
        row("the paper's Newton fit in numpy (fit only), batch", us['newton, batch'], ' us',
            digits=0, note=f'one frame alone {us["newton, one frame"]:.0f} us'),
        row("the paper's method, batch", us['paper, batch'], ' us', digits=0,
            note=f'one frame alone {us["paper, one frame"]:.0f} us'),
        row('curve_fit / ours in batches', us['curve_fit'] / batch, ' x', at_least=10.0,
            digits=0, note=f'one frame alone {us["curve_fit"] / single:.1f} x'),
        row("the paper's method / ours, both in batches", us['paper, batch'] / batch, ' x',
            digits=1),
        row('Newton fit / ours, both in batches', us['newton, batch'] / batch, ' x',
            at_least=10.0, digits=1,
            note=f'one frame alone {us["newton, one frame"] / single:.1f} x'),
    ]


def part_node(pitch, sizes, seed):
    """What the node has to do for samples of both axes, without ROS: images, then angles."""
    encoders = [AbsoluteEncoder(SCALES[pitch], seed, axis) for axis in ('azimuth', 'elevation')]
    readers = [encoder.reader for encoder in encoders]
    count, at_once = 64, (1, 4, 8, 32)
    stamps = 10**6 * np.arange(count)
    angles = np.random.default_rng(seed).uniform(0.0, 1.5, count)
    candidates = {}
    for n in at_once:
        parts = [slice(i, i + n) for i in range(0, count, n)]

        def images(parts=parts):
            return [[e.frames(stamps[part], angles[part], 0.01) for e in encoders]
                    for part in parts]

        frames = images()

        def read(frames=frames):
            return [read_frames(readers, part) for part in frames]

        candidates[f'images, {n}'] = images, 1
        candidates[f'angles, {n}'] = read, 1
    median, _ = time_all(candidates, sizes['rounds'])
    return [row(f'{what} of both axes, {n} samples at once, a sample',
                1e6 * median[f'{what}, {n}'] / count, ' us', digits=0)
            for what in ('images', 'angles') for n in at_once]


# --- the table ------------------------------------------------------------------------------------

PARTS = {'bound': part_bound, 'ladder': part_ladder, 'cut': part_cut, 'total': part_total,
         'gross': part_gross, 'faces': part_faces, 'limits': part_limits, 'focus': part_focus,
         'speed': part_speed, 'node': part_node}
FULL = {'places': 200, 'repeats': 100, 'ladder': 2000, 'total': 10_000, 'gross': 100_000,
        'turns': 200, 'calls': 20, 'rounds': 25}
QUICK = {'places': 60, 'repeats': 40, 'ladder': 256, 'total': 1024, 'gross': 6000,
         'turns': 20, 'calls': 10, 'rounds': 7}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--quick', action='store_true')
    parser.add_argument('--pitch', type=int, choices=tuple(SCALES), help='only that scale')
    parser.add_argument('--only', nargs='+', choices=tuple(PARTS), default=tuple(PARTS))
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--json', type=Path, metavar='FILE')
    args = parser.parse_args()
    sizes = QUICK if args.quick else FULL
    rows, missed = [], 0
    for pitch in (args.pitch,) if args.pitch else tuple(SCALES):
        params = SCALES[pitch]
        print(f'\n{pitch} px a bar, blur {params.blur:g} px, noise {params.noise:g} grey levels '
              f'and 8 bits, seed {args.seed}')
        for part in args.only:
            start = time.monotonic()
            for line in PARTS[part](pitch, sizes, args.seed):
                mark = {True: 'reached', False: 'MISSED', None: ''}[line['reached']]
                missed += line['reached'] is False
                value = ('-' if line['value'] is None
                         else f'{line["value"]:.{line["digits"]}f}{line["unit"]}')
                print(f'  {line["name"]:<62} {value:>14}  {line["target"]:<8} {mark:<8}'
                      f'{line["note"]}'.rstrip(), flush=True)
                rows.append({'pitch': pitch, 'part': part, **line})
            print(f'  [{part}: {time.monotonic() - start:.0f} s]', flush=True)
    if args.json:
        args.json.write_text(json.dumps(rows, indent=1) + '\n')
    print('all targets reached' if not missed else f'{missed} targets MISSED')
    return 1 if missed else 0


if __name__ == '__main__':
    sys.exit(main())
