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

import dataclasses
import math

import numpy as np
import pytest

from encoder_reading.disc import BAR_ANGLE, BARS, Disc, pixel_places
from encoder_sim.absolute import Absolute
from encoder_sim.ccd import LinearCCD, pixel_noise

WIDE_PITCH = {'bar_pitch': 60.0, 'blur': 8.0, 'base': 88.0}


def ccd(seed=0, device='absolute', **params):
    return LinearCCD(dataclasses.replace(Absolute(), **params), Disc(), seed, device)


def dark_places(camera, angle):
    """Pixels of the centres of the whole bars, by their light."""
    depth = np.maximum(camera.light(angle)[0].max() - 60.0 - camera.light(angle)[0], 0.0)
    steps = np.flatnonzero(np.diff(np.r_[0, depth > 0, 0]))
    return np.array([np.average(np.arange(a, b), weights=depth[a:b])
                     for a, b in zip(steps[::2], steps[1::2]) if a > 0 and b < len(depth)])


@pytest.mark.parametrize('params', [{}, WIDE_PITCH, {'blur': 0.5}])
def test_light_is_the_sum_of_all_bars(params):
    camera = ccd(**params)
    p = camera.params
    angle = 200.3 * BAR_ANGLE
    expected = np.full(p.pixels, 250.0 - p.base)
    scale = p.bar_pitch / (math.pi * 79e-3 / 1080)
    for bar in range(175, 226):  # what a row sees, and more
        centre = 0.5 * (p.pixels - 1) + (bar - 200.3) * p.bar_pitch
        half = 0.5 * (0.075e-3 if Disc().bits[bar] else 0.149e-3) * scale
        for x in range(max(int(centre) - 100, 0), min(int(centre) + 100, p.pixels)):
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


# --- what may be wrong --------------------------------------------------------------------------


def test_bars_at_wrong_places():
    plain, camera = ccd(), ccd(bar_position_error=5e-6)
    bar_period = math.pi * 79e-3 / 1080
    place, present = camera.bar_places('absolute')
    assert present.all()
    assert (place - np.arange(1080)).std() * bar_period == pytest.approx(5e-6, rel=0.08)
    # and they are seen there
    seen = dark_places(camera, 0.5) - dark_places(plain, 0.5)
    first = math.ceil(0.5 / BAR_ANGLE - 900 / 48 + 0.4)
    expected = 48 * (place - np.arange(1080))[first : first + len(seen)]
    assert seen == pytest.approx(expected, abs=0.1)
    assert np.std(expected) > 0.5


def test_shifted_and_missing_bars():
    place, _ = ccd(shifted_bars=0.1, bar_shift=0.15).bar_places('absolute')
    off = place - np.arange(1080)
    assert np.count_nonzero(off) == 108
    assert np.abs(off[off != 0]) == pytest.approx(0.15)
    assert 30 < np.count_nonzero(off > 0) < 78
    camera = ccd(missing_bars=0.1)
    _, present = camera.bar_places('absolute')
    assert np.count_nonzero(~present) == 108
    gone = np.flatnonzero(~present)[3]
    assert camera.light(gone * BAR_ANGLE)[0, 890:910].min() > 150
    assert ccd().light(gone * BAR_ANGLE)[0, 899] < 90


def test_flaws_belong_to_the_seed_and_the_disc():
    flaws = {'shifted_bars': 0.1, 'pixel_nonuniformity': 0.02}
    assert np.array_equal(ccd(1, **flaws).light(1.0), ccd(1, **flaws).light(1.0))
    assert not np.array_equal(ccd(1, **flaws).light(1.0), ccd(2, **flaws).light(1.0))
    assert not np.array_equal(ccd(1, 'absolute/elevation', **flaws).light(1.0),
                              ccd(1, 'absolute/azimuth', **flaws).light(1.0))
    first = ccd(1, **flaws)
    second = first.other_head(1)
    # the same disc before other pixels
    ratio = second.light(1.0) / first.light(1.0)
    assert ratio.std() == pytest.approx(0.028, abs=0.002)
    assert second.light(2.0) / first.light(2.0) == pytest.approx(ratio, rel=1e-5)


def test_shading():
    plain, shaded = ccd(), ccd(shading_tilt=0.1, shading_falloff=0.2)
    ratio = (shaded.light(0.7) / plain.light(0.7))[0]
    assert ratio[[0, -1]] == pytest.approx([0.7, 0.9], abs=1e-4)
    assert ratio[899:901].mean() == pytest.approx(1.0, abs=1e-4)
    assert ratio[1350] == pytest.approx(1.0 + 0.05 - 0.05, abs=1e-3)


def test_pixel_nonuniformity_stays():
    ratio = ccd(pixel_nonuniformity=0.02).light([0.7, 2.0]) / ccd().light([0.7, 2.0])
    assert ratio[0].std() == pytest.approx(0.02, abs=0.001)
    assert ratio[0] == pytest.approx(ratio[1], rel=1e-5)


def test_dust_before_the_ccd_stays_and_dust_on_the_disc_moves():
    angles = [0.7, 0.7 + BAR_ANGLE]
    left = ccd(ccd_dust=3, dust_size=60.0).light(angles) / ccd().light(angles)
    assert left[0] == pytest.approx(left[1], abs=1e-5)
    assert left[0].min() < 1e-4 and 170.0 < np.sum(1.0 - left[0]) < 181.0  # two overlap
    on_disc = ccd(disc_dust=80, dust_size=60.0)
    frames = on_disc.light([0.7, 0.7 + BAR_ANGLE])
    assert (frames[0] < 20.0).any()
    assert frames[1, :-48] == pytest.approx(frames[0, 48:], abs=0.05)
    dark = np.mean(on_disc.light(np.linspace(0, 6.28, 60)) < 20.0)
    assert dark == pytest.approx(0.075, abs=0.02)


def test_dust_of_single_frames():
    camera = ccd(dust_size=40.0)
    clean = camera.render([0.7, 0.7])
    dusty = camera.render([0.7, 0.7], dust=np.array([[300.0], [1200.0]]))
    assert dusty[0, 300] == 0 and dusty[1, 1200] == 0
    for row, place in ((0, 300), (1, 1200)):
        changed = np.flatnonzero(dusty[row] != clean[row])
        assert changed.min() > place - 45 and changed.max() < place + 45


def test_scale_error_and_mounting():
    pitch = np.diff(dark_places(ccd(scale_error=0.005), 0.5))
    assert pitch.mean() == pytest.approx(48.24, abs=0.02)
    assert np.diff(dark_places(ccd(), 0.5)).mean() == pytest.approx(48.0, abs=0.02)
    assert ccd(mounting='reversed').light(0.5)[0] == pytest.approx(ccd().light(0.5)[0, ::-1])


def test_flat_row_touches_the_circle():
    params = dataclasses.replace(Absolute(), geometry='tangent')
    radius = 48.0 * 1080 / (2 * math.pi)
    offset = np.arange(1800) - 899.5
    places = pixel_places(params.design, BARS) * BAR_ANGLE
    assert places == pytest.approx(np.arctan(offset / radius))
    flat, bent = dark_places(ccd(geometry='tangent'), 0.5), dark_places(ccd(), 0.5)
    # x / R against tan(x / R): 3.6 pixels further out at the ends, nothing in the middle
    assert bent[0] - flat[0] == pytest.approx((899.5 - bent[0]) ** 3 / (3 * radius**2), abs=0.2)
    assert flat[18] == pytest.approx(bent[18], abs=0.05)


def test_second_pixel_scale():
    assert np.diff(dark_places(ccd(**WIDE_PITCH), 0.5)).mean() == pytest.approx(60.0, abs=0.05)


def test_motion_blur():
    camera = ccd(exposure=2e-3, blur=3.0)
    rate = 10.0 / 48.0 * BAR_ANGLE / 2e-3  # ten pixels in an exposure
    still, moving = camera.light(1.0)[0], camera.light(1.0, rate)[0]
    # the mean of the positions that it runs through, about the middle of the exposure
    along = 1.0 + (np.arange(200) - 99.5) / 200 * rate * 2e-3
    assert moving == pytest.approx(camera.light(along).mean(axis=0), abs=0.05)
    assert np.abs(moving - still).max() > 5.0
    assert camera.light([1.0, 1.0], [-rate, 0.0]) == pytest.approx(
        np.stack([moving, still]), abs=0.3)
    assert np.array_equal(ccd(blur=3.0).light(1.0, rate)[0], still)


def test_shot_noise_grows_with_the_light():
    camera = ccd(full_well=20e3, noise=1.0)
    stamps = np.arange(400)
    frames = camera.frames(stamps, np.full(400, 0.5)).astype(float)
    light = camera.light(0.5)[0]
    for low, high in ((70, 80), (150, 160)):
        at = (light > low) & (light < high)
        expected = 1.0 + light[at].mean() * 255.0 / 20e3 + 1.0 / 12.0
        assert frames[:, at].var(axis=0).mean() == pytest.approx(expected, rel=0.03)


def test_noise_belongs_to_the_stamp():
    camera = ccd(noise=2.0)
    stamps = 1_768_482_000_000_000_000 + 10**6 * np.arange(200)
    together = camera.frames(stamps, np.full(200, 0.5))
    for i in (199, 0, 100):
        assert np.array_equal(camera.frames(stamps[i : i + 1], [0.5])[0], together[i])
    assert not np.array_equal(together[0], together[1])
    assert not np.array_equal(camera.other_head(1).frames(stamps[:1], [0.5])[0], together[0])
    assert np.array_equal(ccd().frames(stamps[:1], [0.5])[0], np.rint(ccd().light(0.5)[0]))


def test_pixel_noise_is_normal():
    noise = pixel_noise(1, 'absolute/azimuth', np.arange(600), 1801)
    assert noise.shape == (600, 1801)
    assert abs(noise.mean()) < 0.004 and noise.std() == pytest.approx(1.0, abs=0.003)
    assert (noise**3).mean() == pytest.approx(0.0, abs=0.012)
    assert (noise**4).mean() == pytest.approx(3.0, abs=0.03)
    assert np.mean(np.abs(noise) > 3.0) == pytest.approx(0.0027, rel=0.08)
    for other in (noise[1:, :], np.roll(noise, 1, axis=1)[1:]):
        assert abs(np.mean(noise[: len(other)] * other)) < 0.004
    assert np.abs(np.corrcoef(noise[:, :40].T) - np.eye(40)).max() < 0.2


@pytest.mark.parametrize('changes', [
    {}, {'bar_pitch': 53.37}, {'mounting': 'reversed'}, {'scale_error': 0.004}])
def test_the_track_is_closed(changes):
    camera = ccd(**changes)
    # rows that see the seam in their first, middle and last pixels
    angles = np.concatenate([np.linspace(-20.0, 20.0, 60) * BAR_ANGLE, [0.0]])
    before, after = camera.light(angles - 1e-7), camera.light(angles + 1e-7)
    assert np.abs(after - before).max() < 0.05
    np.testing.assert_allclose(camera.light(angles + 2 * np.pi), camera.light(angles), atol=1e-3)
