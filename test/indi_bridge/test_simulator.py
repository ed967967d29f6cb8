"""INDI's own telescope simulator: its pointing model is found, and where it acts."""

import numpy as np
import pytest

from calibration.fit import fit_terms
from calibration.sky_model import ON_SKY, origin_of_errors, with_errors
from indi_bridge.client import IndiClient
from indi_bridge.server import DEVICE, SimulatorServer, missing
from indi_bridge.survey import MODEL, Survey, draw_model, places, set_model
from indi_bridge.telescope import IndiTelescope, Ticks
from msg_tools.units import ARCSEC, DEG
from pointing_model.mounts import Mount, is_beyond
from pointing_model.sky import Site

pytest.importorskip('indipyclient', reason='indipyclient is not installed (extra indi)')
pytestmark = pytest.mark.skipif(bool(missing()), reason=missing() or 'all is there')

SEED = 16


def test_its_model_is_found_and_that_it_acts_on_the_sky():
    """Few pointings that lie near each other; the full size is in benchmarks/indi.py."""
    site = Site()
    mount = Mount.equatorial(site.latitude, 'german')
    observer = Survey(mount, site)
    ticks = Ticks(observer.take)
    with SimulatorServer() as server, IndiClient('localhost', server.port, heard=ticks) as client:
        telescope = ticks.telescope = observer.telescope = IndiTelescope(client, DEVICE)
        telescope.connect()
        terms = draw_model(SEED)
        set_model(telescope, terms)
        assert telescope.kind == 'german' and telescope.has_axes
        client.send(DEVICE, 'POLLING_PERIOD', PERIOD_MS=100)
        telescope.prepare(site)
        run = observer.run(places(
            8, SEED, site.latitude, hour_angles=(40.0 * DEG, 85.0 * DEG), south=45.0 * DEG))
        telescope.abort()
        assert not telescope.slewing
    assert is_beyond(run['el_enc']).sum() == 4
    origin = origin_of_errors(run, tuple(MODEL))
    assert origin.holds == ON_SKY and origin.left_out['mount'] > 20.0 * ARCSEC
    model = fit_terms(with_errors(run, ON_SKY), tuple(MODEL)).model
    off = {name: (model.terms[name] - terms[name]) / ARCSEC for name in MODEL}
    assert abs(off.pop('IH')) < 3.0
    assert np.abs(list(off.values())).max() < 2.0
