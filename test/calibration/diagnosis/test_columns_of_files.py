"""Files whose columns are not what they are named are told as their owner wrote them."""

from itertools import product
from pathlib import Path

import numpy as np
import pytest

from calibration.diagnosis import MistakenColumns, check_columns, naming_columns
from msg_tools.units import ARCSEC, DEG, wrap
from pointing_model.geometry import sky_to_encoder
from pointing_model.mounts import Mount, through_pole
from pointing_model.run_files import read_run

CASES = Path(__file__).resolve().parents[4] / 'shared' / 'cases'
LATITUDE = 48.0 * DEG
TERMS = dict(zip(('IH', 'ID', 'CH', 'NP', 'MA', 'ME', 'TF'), (60, -40, 35, -20, 45, -70, 20)))


def written(path, kind='german', pier=True, through=True, n=60, seed=1, places=None,
            readings=None, latitude=LATITUDE):
    """A file of a mount with `TERMS`: hour angles and declinations, degrees.

    `places`, `readings`: what is written in place of ha, dec of catalogue and encoders; with a
    column of the side of the pier readings are places of the sky, else through the pole.
    """
    mount, rng = Mount.equatorial(LATITUDE, kind), np.random.default_rng(seed)
    h, d = rng.uniform(-75.0, 75.0, 4 * n) * DEG, np.arcsin(rng.uniform(-0.3, 0.98, 4 * n))
    h, d = (v[mount.horizon_of(h, d)[1] > 15.0 * DEG][:n] for v in (h, d))
    beyond = (h < 0.0) & (kind == 'german') & through
    a, e = sky_to_encoder(*through_pole(h, d, beyond),
                          {k: v * ARCSEC for k, v in TERMS.items()}, mount)
    a, e = (v + ARCSEC * rng.normal(size=n) for v in (a, e))
    if pier:
        a, e = through_pole(a, e, beyond)
    h, d, a, e = (v / DEG for v in (h, d, wrap(a), e))
    h, d = (places or (lambda x, y: (x, y)))(h, d)
    a, e = (readings or (lambda x, y: (x, y)))(a, e)
    rows = [f'# mount: {kind}', f'# latitude_deg: {latitude / DEG}',
            'ha_deg,dec_deg,ha_enc_deg,dec_enc_deg' + ',pier_side' * pier]
    rows += [f'{w:.7f},{x:.7f},{y:.7f},{z:.7f}' + (',' + ('west' if b else 'east')) * pier
             for w, x, y, z, b in zip(h, d, a, e, beyond)]
    path.write_text('\n'.join(rows) + '\n')
    return path


def checked(path, **options):
    """What the check of a file says; raises MistakenColumns."""
    with naming_columns():
        run = read_run(path, **options)
    return check_columns(run)


def hours(x, y):
    return x / 15.0, y


def gradians(x, y):
    return x / 0.9, y / 0.9


@pytest.mark.parametrize('kind, pier, through', [
    ('german', True, True), ('german', True, False), ('german', False, True),
    ('german', False, False), ('equatorial', False, False)])
def test_units_are_named_whatever_side_of_the_pier(tmp_path, kind, pier, through):
    path = tmp_path / 'run.csv'
    assert checked(written(path, kind, pier, through)).notes == []
    for (write, said), where in product(
            ((hours, 'hour angle {} in hours'),
             (gradians, 'hour angle and declination {} in gradians')),
            ('of the catalogue', 'of the encoders', 'of catalogue and encoders')):
        written(path, kind, pier, through, places='catalogue' in where and write,
                readings='encoders' in where and write)
        with pytest.raises(MistakenColumns, match='fit: ' + said.format(where)):
            checked(path)


@pytest.mark.parametrize('name', ['ger_hours', 'fork_hours'])
def test_hours_of_both_pairs_are_named_on_the_small_input(name):
    path = CASES / f'{name}.csv'
    if not path.is_file():
        pytest.skip(f'no small inputs in {CASES}')
    with pytest.raises(MistakenColumns, match='hour angle of catalogue and encoders in hours'):
        checked(path)
