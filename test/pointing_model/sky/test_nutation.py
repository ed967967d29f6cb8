"""The nutation against all terms of IAU 2006/2000A."""

import erfa
import numpy as np
import pytest

from msg_tools.units import ARCSEC
from pointing_model.sky.nutation import nutation

APART = 1.0 / 24.0
SIN_OBLIQUITY = np.sin(23.4 * np.pi / 180.0)


def on_the_sky(longitude, obliquity):
    """Milliarcseconds by which the pole is elsewhere."""
    return np.hypot(longitude * SIN_OBLIQUITY, obliquity) / ARCSEC * 1e3


@pytest.mark.parametrize('years, worst, rms', [
    ((1900, 2100), 0.48, 0.17), ((1995, 2050), 0.32, 0.11)])
def test_half_a_milliarcsecond_from_all_terms(years, worst, rms):
    days = np.random.default_rng(1).uniform(*((year - 2000) * 365.25 for year in years), 20_000)
    here = np.array([nutation(erfa.DJ00, day, APART)[:2] for day in days]).T
    off = on_the_sky(*(here - erfa.ufunc.nut06a(erfa.DJ00, days)))
    assert off.max() < worst
    assert np.sqrt(np.mean(off**2)) < rms
    short = on_the_sky(*(np.array(erfa.ufunc.nut00b(erfa.DJ00, days))
                         - erfa.ufunc.nut06a(erfa.DJ00, days)))
    assert short.max() > 0.95  # the terms are needed
    assert np.sqrt(np.mean(short**2)) > 2.0 * np.sqrt(np.mean(off**2))


def test_it_changes_as_all_terms_do():
    days = np.random.default_rng(2).uniform(-36500.0, 36500.0, 2000)
    change = np.array([nutation(erfa.DJ00, day, APART)[2] for day in days]).T
    before, after = (np.array(erfa.ufunc.nut06a(erfa.DJ00, days + side * 0.5 * APART))
                     for side in (-1, 1))
    assert on_the_sky(*(change - (after - before))).max() < 0.03
    assert on_the_sky(*change).max() > 1.0
