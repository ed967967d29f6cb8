import dataclasses
import math

import numpy as np
import pytest

from encoder_sim.ccd import LinearCCD
from encoder_sim.disc import BAR_ANGLE, Disc
from encoder_sim.scenario import Absolute

WIDE_PITCH = {'bar_pitch': 60.0, 'blur': 8.0, 'base': 88.0}


def ccd(**params):
    return LinearCCD(dataclasses.replace(Absolute(), **params), Disc())


@pytest.mark.parametrize('params', [{}, WIDE_PITCH, {'blur': 0.5}])
def test_light_is_the_sum_of_all_bars(params):
    camera = ccd(**params)
    p = camera.params
    angle = 200.3 * BAR_ANGLE
    expected = np.full(p.pixels, 250.0 - p.base)
    scale = p.bar_pitch / (math.pi * 79e-3 / 1080)
    for bar in range(150, 251):
        centre = 0.5 * (p.pixels - 1) + (bar - 200.3) * p.bar_pitch
        half = 0.5 * (0.075e-3 if Disc().bits[bar] else 0.149e-3) * scale
        for x in range(p.pixels):
            if abs(x - centre) < 200:
                step = [math.erf((x - centre + s * half) / math.sqrt(2) / p.blur) for s in (1, -1)]
                expected[x] -= p.contrast * 0.5 * (step[0] - step[1])
    assert camera.light(angle)[0] == pytest.approx(expected, abs=0.01)


def test_bars_as_seen_in_the_paper():
    """Widths and integrated grey levels above the threshold 150 of the inverted image."""
    camera = ccd()
    grey = 250.0 - camera.light(np.linspace(0, 6.2, 40))
    widths, totals = [], []
    for row in grey:
        steps = np.flatnonzero(np.diff(np.r_[0, row > 150, 0]))
        for start, end in zip(steps[2:-2:2], steps[3:-2:2]):
            widths.append(end - start)
            totals.append(row[start:end].sum())
    widths, totals = np.array(widths), np.array(totals)
    wide = widths > 18
    assert widths[wide].mean() == pytest.approx(25.9, abs=0.1)
    assert widths[~wide].mean() == pytest.approx(9.9, abs=0.15)
    assert totals[wide].min() > 4200 and totals[wide].max() < 4500
    assert totals[~wide].min() > 1350 and totals[~wide].max() < 1700


def test_frames_are_dark_bars_in_8_bits():
    camera = ccd()
    frame = camera.render(0.5)[0]
    assert frame.dtype == np.uint8 and frame.shape == (1800,)
    assert np.abs(frame - camera.light(0.5)[0]).max() <= 0.5
    # ground 250 - 91, a wide bar 250 - 91 - 88
    assert abs(int(frame.max()) - 159) <= 2 and abs(int(frame.min()) - 71) <= 2


def test_the_image_moves_against_the_pixels_when_the_disc_turns_forward():
    camera = ccd()
    before, after = camera.light([0.5, 0.5 + BAR_ANGLE / 48.0])
    assert after[:-1] == pytest.approx(before[1:], abs=1e-6)


def test_noise_and_saturation():
    camera = ccd(noise=2.0)
    noise = np.random.default_rng(1).normal(size=(3, 1800))
    grey = camera.render([0.1, 0.2, 0.3], noise).astype(float)
    assert (grey - camera.light([0.1, 0.2, 0.3])).std() == pytest.approx(2.02, abs=0.05)
    assert camera.render(0.1, np.full((1, 1800), 200.0)).min() == 255


def test_the_disc_is_closed():
    camera = ccd()
    around = camera.light([-0.001, 2 * np.pi - 0.001, 4 * np.pi - 0.001])
    assert around[0] == pytest.approx(around[1], abs=1e-5)
    assert around[2] == pytest.approx(around[1], abs=1e-5)
