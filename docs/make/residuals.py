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

"""Draws the README's picture: residuals of a measured night before and after the diagnosis.

    .venv/bin/python docs/make/residuals.py
"""

import sys
from pathlib import Path

import matplotlib
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))
matplotlib.use('Agg')
matplotlib.rcParams.update({'svg.hashsalt': 'residuals', 'svg.fonttype': 'none', 'font.size': 10,
                            'font.family': 'sans-serif', 'axes.spines.top': False,
                            'axes.spines.right': False})

from matplotlib import pyplot as plt  # noqa: E402

from telescope_mount import diagnose, fit, read_run  # noqa: E402

BEFORE, AFTER = '#c2410c', '#1d4f7c'


def main():
    """Write docs/pictures/residuals.svg."""
    run = read_run(ROOT / 'calibration' / 'data' / 'mmt_2021-08-21.csv')
    found = diagnose(run)
    figure, (target, against) = plt.subplots(
        1, 2, figsize=(9.2, 3.7), width_ratios=(1, 1.5), layout='constrained')
    for left, colour, marker, label, radius in (
            (found.residuals_before_arcsec, BEFORE, 'o', 'seven terms', found.rms_before_arcsec),
            (found.residuals_after_arcsec, AFTER, '^', 'with the effect found',
             found.rms_after_arcsec)):
        target.plot(*left, marker, color=colour, markersize=4, alpha=0.8)
        target.add_patch(plt.Circle((0, 0), radius, fill=False, color=colour, linewidth=1.5))
        against.plot(found.el_deg, left[1], marker, color=colour, markersize=4.5, alpha=0.8,
                     label=f'{label}: {radius:.2f}″')
    limit = 1.05 * np.abs(found.residuals_before_arcsec).max()
    target.set(xlim=(-limit, limit), ylim=(-limit, limit), aspect='equal',
               xlabel='azimuth × cos E, arcsec', ylabel='elevation, arcsec',
               title='residuals of 80 stars')
    against.axhline(0.0, color='#99a', linewidth=0.8)
    against.set(xlabel='elevation of the star, degrees', ylabel='elevation residual, arcsec',
                title='near the horizon: refraction, or what looks like it')
    against.legend(frameon=False, title='RMS on the sky')
    path = ROOT / 'docs' / 'pictures' / 'residuals.svg'
    figure.savefig(path, metadata={'Date': None, 'Creator': None}, facecolor='white')
    print(path, path.stat().st_size, f'{fit(run).rms_before_arcsec:.2f} raw')


if __name__ == '__main__':
    main()
