"""The commands on runs of mounts that are no alt-azimuth ones."""

import json

import numpy as np
import pytest

from msg_tools.units import ARCSEC, DEG
from pointing_model import geometry
from pointing_model.mounts import Mount
from pointing_model.run import PointingRun
from pointing_model.run_files import write_csv


@pytest.fixture
def german_csv(tmp_path):
    """Forty stars on both sides, with an oval disc."""
    rng = np.random.default_rng(2)
    mount = Mount.equatorial(31.0 * DEG, 'german')
    az, el = rng.uniform(0.0, 6.2, 40), np.arcsin(rng.uniform(0.35, 0.99, 40))
    h, _ = mount.axes_of(az, el)
    a, e = mount.axes_of(az, el, h < 0.0)
    terms = {'IH': 200 * ARCSEC, 'ID': -80 * ARCSEC, 'CH': 60 * ARCSEC, 'ME': 90 * ARCSEC}
    reading = np.array(geometry.sky_to_encoder(a, e, terms, mount))
    reading[0] += 12.0 * ARCSEC * np.sin(2.0 * a + 0.5)
    reading += ARCSEC * rng.normal(size=(2, 40)) / [np.abs(np.cos(e)), np.ones(40)]
    path = tmp_path / 'german.csv'
    write_csv(PointingRun({'az': a, 'el': e, 'az_enc': reading[0], 'el_enc': reading[1]},
                          {'mount': mount}), path)
    return path


def test_fit_prints_the_terms_of_the_mount(ended, german_csv, tmp_path):
    _, out, _ = ended('fit', german_csv, '--predict', '--save', tmp_path / 'model.json')
    for word in ('IH', 'MA', 'TF', ' ha ', ' dec ', 'Chosen to predict', 'HHSH2',
                 'choice repeated'):
        assert word in out, word
    assert json.loads((tmp_path / 'model.json').read_text())['mount']['kind'] == 'german'


def test_diagnose_names_the_axis(ended, german_csv, tmp_path):
    _, out, _ = ended('diagnose', german_csv, '--json', tmp_path / 'found.json')
    assert 'hour angle encoder, 2 per turn' in out
    assert json.loads((tmp_path / 'found.json').read_text())['base_terms'][0] == 'IH'


def test_what_does_not_go_together_is_one_line(refused, german_csv, tmp_path):
    assert 'mount that is altaz are az_enc_deg' in refused('fit', german_csv, '--mount', 'altaz')
    assert 'dobson' in refused('fit', german_csv, '--mount', 'dobson')
    assert '--harmonics' in refused('fit', german_csv, '--predict', '--harmonics', 'zenith')
    bare = tmp_path / 'bare.csv'
    bare.write_text('\n'.join(line for line in german_csv.read_text().splitlines()
                              if not line.startswith('#')))
    assert 'needs the latitude' in refused('fit', bare, '--mount', 'german')
    assert '--longitude' in refused('fit', bare, '--latitude', '31')
