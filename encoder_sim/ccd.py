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

"""The linear CCD of paper 001 and the code disc in front of it, with the flaws of both."""

import copy
import math
from functools import lru_cache

import numpy as np

from encoder_reading.disc import INVERSION, along_track, blurred_bar, half_widths

from . import keyed_noise

_FINE = 64  # entries of the bar's profile per pixel
_CHUNK = 64  # frames rendered at once, to bound the memory
_PIECE = 2**13  # steps of the track tabulated at once: they stay in the processor's cache


class Profile:
    """Profile of one bar in the inverted image, 0 to 1, after the Gaussian blur.

    Parameters
    ----------
    half_widths : sequence of float
        Half widths of the kinds of bars, pixels.
    blur : float
        1-sigma blur, pixels.
    reach : float
        Largest distance for `at`, pixels.
    """

    def __init__(self, half_widths, blur, reach):
        self._last = math.ceil(reach * _FINE)
        distance = np.arange(self._last + 1) / _FINE
        table = np.array([blurred_bar(distance, half, blur) for half in half_widths])
        self._table = table.ravel()
        self._slope = np.diff(table, axis=1, append=table[:, -1:]).ravel()

    def at(self, distance, kind):
        """Light at `distance` (pixels, any shape) from the centre of a bar of `kind`."""
        at = np.minimum(np.abs(distance) * _FINE, self._last)
        entry = at.astype(np.int64)
        at -= entry
        entry += np.asarray(kind) * (self._last + 1)
        return self._table[entry] + at * self._slope[entry]


class LinearCCD:
    """Frames of a disc: dark bars on a light background, in 8 bits.

    Parameters
    ----------
    params : absolute.Absolute
    disc : disc.Disc
    seed : int
        Seed of flaws and noise.
    device : str
        Name of the encoder: discs with the same seed and name have the same flaws.

    Notes
    -----
    The light of the whole track is tabulated once, so flaws of the disc cost nothing later, and
    a frame is a table look-up. For a disc that leaves the focus (`defocus`) there are tables of
    several blurs, between which frames are interpolated.
    """

    def __init__(self, params, disc, seed=0, device='absolute'):
        self.params, self.disc = params, disc
        self._seed, self._device = seed, f'{device}/0'
        # table entries: about so many per pixel, and a whole number per turn
        turn = disc.bars * params.bar_pitch
        self._last = round(turn * int(np.clip(48.0 / params.blur, 8.0, 64.0)))
        self._steps = self._last / turn
        track = self._ground(device)
        self._smeared = None
        self._defocus = Defocus(params, self._steps)
        self._blurred = None if self._defocus.sharp else self._defocus.tables(track)
        offset = np.arange(params.pixels) - 0.5 * (params.pixels - 1)
        if params.mounting == 'reversed':
            offset = -offset
        self._offset = self._steps * params.bar_pitch * along_track(
            offset / (params.bar_pitch * (1.0 + params.scale_error)), params.geometry,
            disc.bars)
        # start of a row in the table, entry of each pixel relative to it, and the fraction left
        self._begin = math.floor(self._offset.min())
        entry = np.floor(self._offset)
        self._entry = (entry - self._begin).astype(np.intp)
        self._over = (self._offset - entry).astype(np.float32)
        # continue the table for rows that extend beyond the turn
        self._track = np.take(track, np.arange(self._last + self._entry.max() + 3), mode='wrap')
        self._gain = self._sensitivity().astype(np.float32)

    def other_head(self, number):
        """Another CCD with its own pixels in front of the same disc; `number` is 1, 2, ...."""
        other = copy.copy(self)
        other._device = f'{self._device.rsplit("/", 1)[0]}/{number}'
        other._gain = other._sensitivity().astype(np.float32)
        return other

    # --- what does not change -----------------------------------------------------------------

    def _draw(self, device, purpose, n, kind=keyed_noise.uniform):
        return kind(self._seed, device, purpose, np.arange(n))

    def bar_places(self, device):
        """Positions of the bars' centres in bar periods, and which bars exist, shape (bars,)."""
        p, n = self.params, self.disc.bars
        period = math.pi * p.diameter / n
        place = np.arange(float(n))
        place += p.bar_position_error / period * self._draw(
            device, 'bar places', n, keyed_noise.normal)
        shifted = np.argsort(self._draw(device, 'shifted bars', n))[: round(p.shifted_bars * n)]
        side = np.sign(self._draw(device, 'side of the shift', n) - 0.5)
        place[shifted] += p.bar_shift * side[shifted]
        missing = np.argsort(self._draw(device, 'missing bars', n))[: round(p.missing_bars * n)]
        present = np.ones(n, dtype=bool)
        present[missing] = False
        return place, present

    def _ground(self, device):
        """Grey level along the track, `_steps` per pixel, for one turn from the middle of bar 0."""
        p, n = self.params, self.disc.bars
        place, present = self.bar_places(device)
        shift = (place - np.arange(n)) * p.bar_pitch
        kind = np.where(present, self.disc.bits, 2).astype(np.int64)
        reach = 1.5 * p.bar_pitch + np.abs(shift).max() + 1.0
        # a missing bar has zero width
        profile = Profile((*half_widths(p.design, n), 0.0), p.blur, reach)
        grey = np.empty(self._last)
        for i in range(0, len(grey), _PIECE):
            pixel = np.arange(i, min(i + _PIECE, len(grey))) / self._steps
            bar = np.rint(pixel / p.bar_pitch).astype(np.int64)
            distance = pixel - bar * p.bar_pitch
            light = np.zeros(len(pixel))
            for k in (-1, 0, 1):
                other = (bar + k) % n
                light += profile.at(distance - k * p.bar_pitch - shift[other], kind[other])
            grey[i : i + len(pixel)] = light
        grey = INVERSION - p.base - p.contrast * grey
        if p.disc_dust:
            around = n * p.bar_pitch
            pixel = np.arange(len(grey)) / self._steps
            for centre in around * self._draw(device, 'dust on the disc', p.disc_dust):
                distance = np.abs((pixel - centre + 0.5 * around) % around - 0.5 * around)
                near = distance < 0.5 * p.dust_size + 5.0 * p.blur
                grey[near] *= 1.0 - blurred_bar(distance[near], 0.5 * p.dust_size, p.blur)
        return grey.astype(np.float32)

    def _sensitivity(self):
        """Relative sensitivity of each pixel: shading, dust, non-uniformity."""
        p = self.params
        along = np.linspace(-1.0, 1.0, p.pixels)
        gain = 1.0 + p.shading_tilt * along - p.shading_falloff * along**2
        gain *= 1.0 + p.pixel_nonuniformity * self._draw(
            self._device, 'pixels', p.pixels, keyed_noise.normal)
        places = p.pixels * self._draw(self._device, 'dust on the CCD', p.ccd_dust)
        return gain * self.dust(places[np.newaxis])[0]

    def dust(self, places):
        """Transmission of the dust in front of the CCD, 0 to 1.

        Parameters
        ----------
        places : array_like, shape (n, k)
            Centres, in pixels, of k opaque particles of the size ``params.dust_size``.

        Returns
        -------
        ndarray, shape (n, pixels)
        """
        p = self.params
        half = 0.5 * p.dust_size
        profile = Profile((half,), p.blur, half + 6.0 * p.blur)
        left = np.ones((len(places), p.pixels))
        for column in np.transpose(places):
            left *= 1.0 - profile.at(np.arange(p.pixels) - column[:, np.newaxis], 0)
        return left

    # --- frames -------------------------------------------------------------------------------

    def light(self, angles, rates=0.0):
        """Grey levels without noise or rounding.

        Parameters
        ----------
        angles : array_like, shape (n,)
            Angle of the disc at the middle of the row, rad.
        rates : array_like, shape (n,), optional
            Rate of the disc, rad/s: smears the image during ``params.exposure``.

        Returns
        -------
        ndarray of float32, shape (n, pixels)
        """
        p = self.params
        angles = np.atleast_1d(np.asarray(angles, dtype=float))
        bars = self.disc.bars
        if self._blurred is not None:
            return self._out_of_focus(angles, np.asarray(rates)) * self._gain
        place = (angles / self.disc.bar_angle) % bars * (p.bar_pitch * self._steps)
        if p.exposure > 0.0:
            smear = np.abs(np.asarray(rates)) * p.exposure / self.disc.bar_angle * p.bar_pitch
            if np.max(smear) > 0.25:  # pixels; below, less than 0.2 % of the sharpest blur
                half = np.broadcast_to(0.5 * smear * self._steps, angles.shape)[:, np.newaxis]
                at = place[:, np.newaxis] + self._offset
                return self._smear(at, np.maximum(half, 0.125 * self._steps)) * self._gain
        return self._look(place) * self._gain

    def _look(self, place):
        """The track as seen by rows with their middle at `place` (steps)."""
        first = np.floor(place)
        at = self._over + (place - first).astype(np.float32)[:, np.newaxis]
        more = at >= 1.0
        at -= more
        first = (first.astype(np.intp) + self._begin) % self._last
        entry = self._entry + first[:, np.newaxis]
        entry += more
        grey = self._track[entry]
        entry += 1
        rise = self._track[entry]
        rise -= grey
        rise *= at
        grey += rise
        return grey

    def _out_of_focus(self, angles, rates):
        """The track for `light`, blurred according to its height where it is read."""
        p, focus = self.params, self._defocus
        height = focus.height(angles)
        shown = angles + focus.shift(height)
        lower, part = focus.between(height)
        offset = self._offset / focus.growth(height)[:, np.newaxis]
        way = np.broadcast_to(rates * p.exposure, angles.shape)
        pixels = np.abs(way).max() / self.disc.bar_angle * p.bar_pitch
        # approximate the smear by averaging looks half a pixel apart
        looks = 1 if pixels <= 0.25 else math.ceil(2.0 * pixels)
        grey = np.zeros(offset.shape, dtype=np.float32)
        for look in range(looks):
            at = shown + way * ((look + 0.5) / looks - 0.5)
            place = (at / self.disc.bar_angle) * (p.bar_pitch * self._steps)
            place = (place[:, np.newaxis] + offset) % self._last
            entry = np.floor(place)
            over = (place - entry).astype(np.float32)
            # the remainder may be rounded up to a whole turn
            entry = entry.astype(np.intp) % self._last
            beside = (entry + 1) % self._last
            for table, weight in ((lower, 1.0 - part), (lower + 1, part)):
                if weight.any():
                    row = np.minimum(table, len(self._blurred) - 1)[:, np.newaxis]
                    one, other = self._blurred[row, entry], self._blurred[row, beside]
                    grey += weight.astype(np.float32)[:, np.newaxis] * (one + over * (other - one))
        return grey / np.float32(looks)

    def _smear(self, at, half):
        """Mean of the track over `half` steps to both sides."""
        if self._smeared is None:
            total = np.zeros(self._last + 2)
            track = self._track[: self._last + 2].astype(float)
            np.cumsum(0.5 * (track[1:] + track[:-1]), out=total[1:])
            self._smeared = total
        total = self._smeared
        turn = total[self._last]

        def integral(place):
            entry = np.floor(place).astype(np.int64)
            part = place - entry
            turns, entry = np.divmod(entry, self._last)
            low = total[entry]
            return turns * turn + low + part * (total[entry + 1] - low)

        return ((integral(at + half) - integral(at - half)) / (2.0 * half)).astype(np.float32)

    def render(self, angles, noise=None, rates=0.0, dust=None, lamp=None):
        """Frames as delivered by the CCD.

        Parameters
        ----------
        angles : array_like, shape (n,)
            Angle of the disc at the middle of the row, rad.
        noise : ndarray, shape (n, pixels), optional
            In units of its standard deviation, from ``params.noise`` and the shot noise.
        rates : array_like, shape (n,), optional
            Rate of the disc, rad/s.
        dust : ndarray, shape (n, k), optional
            Positions of additional dust in pixels, for each frame.
        lamp : ndarray, shape (n,), optional
            Relative light of the lamp in each frame.

        Returns
        -------
        ndarray of uint8, shape (n, pixels)
        """
        angles = np.atleast_1d(np.asarray(angles, dtype=float))
        if np.ndim(rates) == 0:
            rates = np.full(angles.shape, rates)
        out = np.empty((len(angles), self.params.pixels), dtype=np.uint8)
        for i in range(0, len(angles), _CHUNK):
            rows = slice(i, i + _CHUNK)
            grey = self.light(angles[rows], rates[rows])
            if dust is not None:
                grey *= self.dust(dust[rows])
            if lamp is not None:
                grey *= lamp[rows, np.newaxis].astype(np.float32)
            if noise is not None:
                grey += noise[rows] * self._sigma(grey)
            np.rint(grey, out=grey)
            np.maximum(grey, 0.0, out=grey)
            np.minimum(grey, 255.0, out=grey)
            out[rows] = grey
        return out

    def _sigma(self, grey):
        p = self.params
        if p.full_well == 0.0:
            return np.float32(p.noise)
        return np.sqrt(p.noise**2 + np.maximum(grey, 0.0) * (255.0 / p.full_well))

    def frames(self, stamps, angles, rates=0.0, lamp=None):
        """Frames with noise, which is determined by their stamps.

        Parameters
        ----------
        stamps : array_like of int, shape (n,)
            ns.
        angles, rates, lamp
            See `render`.
        """
        p = self.params
        if p.noise == 0.0 and p.full_well == 0.0:
            return self.render(angles, rates=rates, lamp=lamp)
        noise = pixel_noise(self._seed, self._device, stamps, p.pixels)
        return self.render(angles, noise, rates, lamp=lamp)


@lru_cache(maxsize=1)
def _quantiles():
    """Centres of 65 536 equally likely parts of the normal distribution."""
    from statistics import NormalDist

    # compute some exactly, densely in the tail, and interpolate between them
    p = (np.arange(32768) + 0.5) / 65536
    ends = np.unique(np.concatenate([np.arange(256), np.geomspace(256, 32767, 512).astype(int)]))
    inverse = NormalDist().inv_cdf
    lower = np.interp(np.arange(32768), ends, [inverse(p[i]) for i in ends])
    values = np.concatenate([lower, -lower[::-1]])
    return (values / values.std()).astype(np.float32)


def pixel_noise(seed, device, stamps, pixels):
    """Normal random numbers of mean 0 and standard deviation 1, one per pixel.

    Each uses 16 of the bits of `keyed_noise.bits`, with a table: many times faster than
    `keyed_noise.normal`, equally independent, and good enough for pixels in 8 bits: 65 536
    different values, up to 4.3.

    Parameters
    ----------
    seed, device, stamps
        See `keyed_noise.normal`.
    pixels : int

    Returns
    -------
    ndarray of float32, shape (len(stamps), pixels)
    """
    bits = keyed_noise.bits(seed, device, 'pixel noise', stamps, -(-pixels // 4))
    return _quantiles()[bits.view(np.uint16)[:, :pixels]]


#: ratio of the squared blur between adjacent tables of the track
_GROWTH = 1.1


class Defocus:
    """Defocus of a disc with axial run-out or tilt.

    Parameters
    ----------
    params : absolute.Absolute
    steps : float
        Table entries per pixel.

    Attributes
    ----------
    sharp : bool
        Whether the disc stays in focus, so that its image is that of an ideal disc.

    Notes
    -----
    At a distance z from the focus a point becomes a patch of radius z tan u, with sin u the
    numerical aperture. Its 1-sigma is half of that, added to the blur in quadrature, as for a
    Gaussian. For light at an angle w along the track, the image moves by z tan w.
    """

    def __init__(self, params, steps):
        p = self._params = params
        self._radius = 0.5 * p.diameter
        self._stroke = self._radius * math.sin(p.tilt)
        self._farthest = abs(p.focus_error) + p.runout + abs(self._stroke)
        self._steps = steps
        self.sharp = self._farthest * max(p.defocus_slope, abs(p.lean), abs(p.image_growth)) == 0.0

    def height(self, angles):
        """Distance of the track from the focus, m, where it is read at the disc angles `angles`."""
        p = self._params
        return (p.focus_error + p.runout * np.cos(angles - p.runout_phase)
                + self._stroke * np.sin(angles - p.tilt_phase))

    def shift(self, height):
        """Apparent shift of the disc, rad, with the track at `height` (m)."""
        return height * math.tan(self._params.lean) / self._radius

    def growth(self, height):
        """Relative scale of the image with the track at `height` (m)."""
        return 1.0 + self._params.image_growth * height

    def tables(self, track):
        """The track with increasing blur.

        Parameters
        ----------
        track : ndarray, shape (entries,)
            Track of one turn.

        Returns
        -------
        ndarray, shape (tables, entries)
        """
        sharp = self._params.blur**2
        most = (self._params.defocus_slope * self._farthest) ** 2
        n = 1 + math.ceil(math.log1p(most / sharp) / math.log(_GROWTH))
        self._variance = sharp * (_GROWTH ** np.arange(n) - 1.0)
        wave = np.fft.rfftfreq(len(track)) * (2.0 * np.pi * self._steps)  # 1/pixel
        spectrum = np.fft.rfft(track.astype(float))
        return np.array([
            np.fft.irfft(spectrum * np.exp(-0.5 * more * wave**2), len(track))
            for more in self._variance], dtype=np.float32)

    def between(self, height):
        """Index of the table below the blur of each height, and the fraction to the next one."""
        more = (self._params.defocus_slope * height) ** 2
        if len(self._variance) == 1:
            return np.zeros(len(more), dtype=np.intp), np.zeros(len(more))
        lower = np.clip(np.searchsorted(self._variance, more, side='right') - 1, 0,
                        len(self._variance) - 2)
        return lower, (more - self._variance[lower]) / np.diff(self._variance)[lower]
