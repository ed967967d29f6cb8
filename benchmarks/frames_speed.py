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

"""Speed of reading batches of clean and dirty encoder frames: ours and the paper's Newton fit.

    OMP_NUM_THREADS=1 python benchmarks/frames_speed.py [--rounds N]

The peer is the sine fit of the paper in numpy (`encoder_reading.paper_reader`, nothing to install),
without its decoding. Errors of the readings are printed; bounds: `absolute_encoder.py`.
"""

from dataclasses import replace

import numpy as np
from absolute_encoder import (
    BLOBS,
    INVERSION,
    SCALES,
    SHADING,
    SHIFTED,
    WINDOW,
    PaperReader,
    Source,
    TemplateReader,
    sine_start,
)
from encoder_frames import Tally
from race import Row, race, show_rows

BATCH = 1024
LEAST = 10.0  # times as fast as the paper's fit, a dirty frame


def rows(rounds=5, pitch=48, seed=1):
    """`race.Row`, seconds a frame."""
    params = SCALES[pitch]
    shaded = replace(params, **SHADING)
    sources = {'clean': Source(params, seed),
               'with 10 % of the bars shifted': Source(replace(shaded, **SHIFTED), seed),
               'with three blobs': Source(shaded, seed, BLOBS)}
    template, paper = TemplateReader(params.design), PaperReader(params.design)
    newton, out = "the paper's Newton fit", []
    for name, source in sources.items():
        angles, frames = source.random(BATCH)
        grey = INVERSION - frames[:64].astype(float)
        start = sine_start(np.arange(WINDOW), paper.decode(grey).centre[:, :WINDOW])
        tally = Tally(source.disc.bar_angle)
        tally.add(template.read(frames), angles)
        print(f'{name}: {tally.rms:.3f}" rms, {tally.rejected} rejected, {tally.gross} gross')
        times = race({'ours': lambda f=frames: template.read(f),
                      newton: lambda g=grey, s=start: paper.fit(g, *s)}, rounds)
        ours, what = times['ours'] / BATCH, f'frames {name}, each'
        out.append(Row('encoder', what, str(BATCH), ours, newton, times[newton] / 64,
                       None if name == 'clean' else LEAST))
    return out


if __name__ == '__main__':
    show_rows(__doc__, rows)
