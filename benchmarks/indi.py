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

"""INDI's telescope simulator with its own pointing model: are its six terms recovered, and is it
recognised that they act on the sky before the flip?

    python benchmarks/indi.py [--seeds N] [--pointings N] [--checks N] [--full]

Each seed draws a MOUNT_MODEL of 0.02 to 0.1 deg per term, starts a server (indiserver, Debian
package indi-bin), points on both sides of the meridian and reads axes and place at the ticks of the
driver. The driver points through the inverse of its own model, so blind errors are evaluated on its
axes: the difference of the fitted model's axis angles from the true ones at places not used in the
fit. `--full` takes 5 seeds of 20 pointings and 8 checks (half an hour, nearly all waiting).
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np
from indi_survey import Survey, places

from calibration.analysis.sky_model import ON_SKY, origin_of_errors, with_errors
from calibration.analysis.term_fit import fit_terms
from calibration.report.fit_wording import origin_sentence
from msg_tools.units import ARCSEC
from pointing_model.mounts import Mount
from pointing_model.rms import rms
from pointing_model.sky.site import Site
from telescope_mount.bridges.indi.client import IndiClient
from telescope_mount.bridges.indi.indi_telescope import IndiTelescope, Ticks

sys.path.append(str(Path(__file__).resolve().parents[1] / 'examples' / 'simulated_servers'))
from indi_server import DEVICE, SimulatorServer, missing
from indi_simulator import MODEL, set_model
from two_axes import draw_errors


def survey(seed, pointings, checks, period_ms=100):
    """One server, one model: terms set (rad), run, and run of the checks."""
    site = Site()
    mount = Mount.equatorial(site.latitude, 'german')
    observer = Survey(mount, site)
    ticks = Ticks(observer.take)
    with SimulatorServer() as server, IndiClient('localhost', server.port, update=ticks) as client:
        telescope = ticks.telescope = observer.telescope = IndiTelescope(client, DEVICE)
        telescope.connect()
        terms = draw_errors(seed, MODEL)
        set_model(telescope, terms)
        client.send(DEVICE, 'POLLING_PERIOD', PERIOD_MS=period_ms)
        telescope.prepare(site)
        wanted = places(pointings, seed, site.latitude)
        blind = places(checks, seed + 1000, site.latitude) if checks else np.empty((0, 2))
        both = observer.run(np.vstack((wanted, blind)))
    is_check = np.arange(len(both)) >= pointings
    return terms, both.select(~is_check), both.select(is_check)


def judge(terms, run, checks):
    """Errors of the terms, residuals of both hypotheses, blind errors; arcsec."""
    names = tuple(MODEL)
    origin = origin_of_errors(run, names)
    fit = fit_terms(with_errors(run, ON_SKY), names)
    off = {name: (fit.model.terms[name] - terms[name]) / ARCSEC for name in names}
    blind = np.nan
    if len(checks):
        blind = float(rms(*fit.model.residuals(checks))) / ARCSEC
    return off, origin, blind


def main(args=None):
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n\n')[0])
    parser.add_argument('--seeds', type=int, default=1)
    parser.add_argument('--pointings', type=int, default=12)
    parser.add_argument('--checks', type=int, default=4)
    parser.add_argument('--full', action='store_true')
    given = parser.parse_args(args)
    if given.full:
        given.seeds, given.pointings, given.checks = 5, 20, 8
    if missing():
        sys.exit(missing())
    worst = dict.fromkeys(MODEL, 0.0)
    right, blinds, rows = 0, [], 0
    for seed in range(1, given.seeds + 1):
        began = time.monotonic()
        terms, run, checks = survey(seed, given.pointings, given.checks)
        off, origin, blind = judge(terms, run, checks)
        rows += len(run)
        worst = {name: max(worst[name], abs(off[name])) for name in MODEL}
        right += origin.holds == ON_SKY
        blinds.append(blind)
        print(f'seed {seed}: ' + ' '.join(f'{name} {terms[name] / ARCSEC:+.1f} ({off[name]:+.2f})'
                                          for name in MODEL))
        print(f'    {origin_sentence(origin)}')
        print(f'    blind {blind:.2f} arcsec at {len(checks)} places; '
              f'{time.monotonic() - began:.0f} s', flush=True)
    print(f'\n{given.seeds} models, {rows} pointings on both sides')
    for what, figure, target in (
            ('largest error of ID CH NP MA ME, arcsec',
             f'{max(worst[name] for name in MODEL if name != "IH"):.2f}', '2'),
            ('largest error of IH (clock), arcsec', f'{worst["IH"]:.2f}', '3'),
            ('the right one of both hypotheses', f'{right} of {given.seeds}', 'all'),
            ('blind error on its axes, radial RMS, arcsec', f'{np.max(blinds):.2f}', '5')):
        print(f'{what:48} {figure:>10}   target {target}')


if __name__ == '__main__':
    main()
