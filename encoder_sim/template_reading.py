"""The reading that ships: every visible bar is compared with what it must look like there."""

import math
from dataclasses import dataclass

import numpy as np

from .ccd import blurred_bar, half_widths, pixel_places
from .disc import windows_of
from .readings import REJECTED, Readings, checked_frames

_TURN = 2.0 * np.pi
_TRY = 0.006  # relative scale at which the phases are compared
_CHUNK = 64  # frames worked on at once: they fit into the cache

#: why a frame was rejected, by the number in `TemplateReadings.reason`
REASONS = ('', 'not finite', 'saturated', 'no contrast', 'not on the disc', 'ambiguous',
           'bars out of line', 'wrong direction')
(_NOT_FINITE, _SATURATED, _NO_CONTRAST, _NOT_ON_DISC, _AMBIGUOUS, _OUT_OF_LINE,
 _WRONG_DIRECTION) = range(1, 8)
_OUTLIER = 6.0 * 1.4826  # median deviations at which level or contrast is no bar's
_UNLIKE = 0.1  # of the contrast, by which a bar may differ from both kinds
_DISPLACED = 0.08  # bar periods off its place, from which the width of a bar misleads
_FLAT = 0.01  # relative deviation that is not
_SHARPEST = 3.0  # blur of the template's slopes, pixels: they move in the series below
_CUT = 6.0  # of Tukey's weights: costs 2 % where the noise is normal
_FEWEST = 22  # bars, that tell the direction
_TINY = np.float32(1e-6)
_HALF = np.float32(0.5)


@dataclass(frozen=True)
class TemplateReadings(Readings):
    """What `TemplateReader` says of n frames beside angle and quality.

    Attributes
    ----------
    reason : ndarray of int8, shape (n,)
        Index into `REASONS`; 0 where the frame was read.
    backwards : ndarray of bool, shape (n,)
        The pixels run against the disc.
    wrong : ndarray of int, shape (n,)
        Visible bars that are not as the code has them, or that could not be read.
    used : ndarray of int, shape (n,)
        Bars that decided the angle.
    sigma : ndarray, shape (n,)
        Standard error of the angle from the scatter of the bars about their line, rad.
    """

    reason: np.ndarray
    backwards: np.ndarray
    wrong: np.ndarray
    used: np.ndarray
    sigma: np.ndarray


class TemplateReader:
    """Decode, then fit the template of the decoded bars.

    1. Sine and cosine of the nominal bar period under windows along the row give phase and scale
       to a tenth of a pixel, whatever the bits.
    2. A stretch of the row about each bar is compared with a wide and with a narrow bar: bit,
       contrast and level. A bar that resembles neither is left out.
    3. The bits are compared with all places of the disc at once.
    4. The slope of its two edges, of which the code knows whether they are those of a wide or of a
       narrow bar and between which neighbours, gives the shift of each bar; contrast and level
       come from a smooth curve along the row, so that shading does not act as a shift.
    5. A robust straight line through the shifts gives place and scale; with the weights of step 4
       it is the least-squares fit of the whole template. Where the line has moved by more than
       the response is straight, or bars are off it, once more from there: then it is also known
       what the displaced and missing bars change in the stretches of their neighbours.

    A frame that runs against the disc is recognised, for from 22 bars on no window of the codes
    read backwards is one read forwards; the angle in the middle of the row is the same.

    Parameters
    ----------
    params : scenario.Absolute
        Of which it uses the nominal image: pixels, bar_pitch, blur, bar widths, geometry.
    disc : disc.Disc
    direction : {'detect', 'forward', 'reversed'}
        In which direction the pixels may run; a frame in the other one is rejected.

    Raises
    ------
    ValueError
        Unknown direction; fewer than 22 bars in view; bars so blurred that wide and narrow cannot
        be told apart.
    """

    #: bits by which the match must surpass what chance finds among all places and directions
    MIN_EVIDENCE = 13.0
    #: the same where every legible bar fits, so that bars may be illegible
    MIN_EVIDENCE_EXACT = 9.0
    #: bits by which any other place must fit worse, unless all bars fit
    MIN_MARGIN = 2
    #: of the pixels, at 255
    MAX_SATURATED = 0.05
    #: grey levels
    MIN_CONTRAST = 4.0
    #: of the visible bars, in the line
    MIN_SHARE = 0.5
    #: scatter of the bars about their line, bar periods
    MAX_SCATTER = 0.1
    #: relative error of the scale
    MAX_SCALE = 0.02
    _PASSES = 3

    def __init__(self, params, disc, direction='detect'):
        if direction not in ('detect', 'forward', 'reversed'):
            raise ValueError(f"direction {direction!r} is not one of 'detect', 'forward', "
                             "'reversed'")
        self.params, self.disc, self.direction = params, disc, direction
        self.pixels = params.pixels
        self._place = pixel_places(params, disc.bars)
        self._place32 = self._place.astype(np.float32)
        self._scale = np.gradient(self._place).astype(np.float32)  # bar periods a pixel
        self._flat = params.geometry == 'tangent'
        # bar periods, up to which the response is a straight line: 0.06 % of it are left
        self._enough = 0.05 * max(params.blur, _SHARPEST) / params.bar_pitch
        self._backwards = False
        self._prepare_phase()
        self._prepare_bars()
        self._prepare_code()

    # --- prepared once ------------------------------------------------------------------------

    def _prepare_phase(self):
        """Windowed sine and cosine of the bar period, shape (pixels, 2 * windows)."""
        width, step = 5.0, 2.5
        n = int((self._place[-1] - self._place[0] - width) / step) + 1
        self._middles = step * (np.arange(n) - 0.5 * (n - 1))
        columns = []
        for middle in self._middles:
            x = self._place - middle
            window = np.where(np.abs(x) < 0.5 * width, np.cos(np.pi * x / width) ** 2, 0.0)
            # blind to level and slope of the ground
            ground = np.stack([np.ones_like(x), x], axis=1)
            wave = -np.exp(-1j * _TURN * self._place)
            project = np.linalg.solve(ground.T @ (window[:, None] * ground), ground.T * window)
            columns.append(window * (wave - ground @ (project @ wave)))
        self._turns = (_TURN * self._middles).astype(np.float32)
        # float32 pairs: a product with them is seen as complex numbers
        pairs = np.stack(columns, axis=1).astype(np.complex64)
        self._waves = np.ascontiguousarray(pairs).view(np.float32)
        self._tries = np.exp(
            1j * _TURN * np.outer(self._middles, [-_TRY, 0.0, _TRY])).astype(np.complex64)

    def _prepare_bars(self):
        p = self.params
        halves = half_widths(p, self.disc.bars)
        blur = max(p.blur, _SHARPEST)
        self._half = h = int(np.ceil(halves[0] + 2.0 * blur))
        x = np.arange(-h, h + 1.0)

        def taper(x):
            # to nothing at the ends, for they move with the template
            edge = np.clip((h - np.abs(x)) / (0.35 * h), 0.0, 1.0)
            return edge * edge * (3.0 - 2.0 * edge)

        def slope(x, half):
            root = -0.5 / blur**2
            norm = 1.0 / (np.sqrt(_TURN) * blur)
            edges = np.exp(root * (x - half) ** 2) - np.exp(root * (x + half) ** 2)
            return norm * edges * taper(x)

        # step 2: level, share of a wide and of a narrow bar
        inner = np.abs(x) <= 0.5 * p.bar_pitch
        combos = np.arange(8)
        bits = np.stack([combos >> 2, combos >> 1 & 1, combos & 1], axis=1)

        def light(x, shift=0.0):
            return np.array([
                sum(blurred_bar(np.abs(x - shift - (k - 1) * p.bar_pitch), halves[b[k]], p.blur)
                    for k in range(3)) for b in bits])

        lights = light(x)
        wide = lights[[0, 1, 4, 5]].mean(axis=0)
        narrow = lights[[2, 3, 6, 7]].mean(axis=0)
        wide, narrow = 0.5 * (wide + wide[::-1]), 0.5 * (narrow + narrow[::-1])
        shapes = np.stack([np.ones(len(x)), -wide, -narrow], axis=1)[inner]
        solve = np.zeros((3, len(x)))
        solve[:, inner] = np.linalg.pinv(shapes)
        self._inner = slice(int(np.argmax(inner)), int(np.argmax(inner)) + np.count_nonzero(inner))
        # what an undisturbed bar of contrast 1 shows, by its bits and those of its neighbours
        seen = lights @ solve.T
        self._level_of = seen[:, 0].astype(np.float32)
        self._contrast_of = -(seen[:, 1] + seen[:, 2]).astype(np.float32)
        # what a bar may show, which lies half a pixel and a bit off; some noise comes on top
        share = np.abs(seen[:, 2] - seen[:, 1]) / self._contrast_of
        if np.linalg.cond(shapes) > 200.0 or share.min() < 0.3:
            raise ValueError(
                f'bar_pitch {p.bar_pitch:g} px with blur {p.blur:g} px: wide and narrow bars '
                'cannot be told apart; use a larger pitch, less blur or other widths')
        self._explained = np.linalg.cholesky(shapes.T @ shapes).T.astype(np.float32)
        low, high = 0.45 * share.min(), 0.9 + share.max()
        self._share = 0.5 * (high + low), 0.5 * (high - low)
        moved = light(x, 0.75)
        rest = moved[:, inner] - (moved @ solve.T) @ shapes.T
        self._unlike = max(_UNLIKE, 1.3 * np.sqrt(np.mean(rest**2, axis=1).max()))

        # step 4: the slope W and the terms of its Taylor series, for wide and narrow
        step = 0.05
        rows = []
        for half in halves:
            f = [slope(x + k * step, half) for k in (-2, -1, 0, 1, 2)]
            rows += [f[2], (f[3] - f[1]) / (2 * step), (f[3] - 2 * f[2] + f[1]) / (2 * step**2),
                     (f[4] - 2 * f[3] + 2 * f[1] - f[0]) / (12 * step**3)]
        weights = np.array(rows).reshape(2, 4, -1)
        self._columns = np.ascontiguousarray(
            np.concatenate([solve, weights.reshape(8, -1)]).astype(np.float32))

        own = weights[bits[:, 1], 0]
        response = [np.sum(own * light(x, s), axis=1) for s in (-0.25, 0.0, 0.25)]
        self._response = response[1].astype(np.float32)
        slopes = (response[2] - response[0]) / 0.5
        # of the response, as a share of the contrast: that of a bar so far from its place
        self._displaced = _DISPLACED * p.bar_pitch * slopes.min()
        self._response_slope = slopes.astype(np.float32)
        # of it, what the right neighbour adds, by both bits, when it is shifted; a left one takes
        # the same away when it is shifted the other way
        self._shifts = np.linspace(-0.3, 0.3, 25) * p.bar_pitch
        self._neighbour = np.array([
            [[weights[mine, 0] @ blurred_bar(np.abs(x - p.bar_pitch - s), halves[other], p.blur)
              for s in self._shifts] for other in (0, 1)] for mine in (0, 1)])
        alone = np.array([[weights[k, 0] @ blurred_bar(np.abs(x - s), halves[k], p.blur)
                           for s in self._shifts] for k in (0, 1)])
        # a shift so large that the slope is left behind looks smaller
        middle = len(self._shifts) // 2
        gain = (alone[:, middle + 1] - alone[:, middle - 1]) / (
            self._shifts[middle + 1] - self._shifts[middle - 1])
        self._apparent = np.maximum.accumulate(alone / gain[:, np.newaxis], axis=1)
        # a slope of the ground, and of the contrast, acts as a shift
        self._ground_moment = np.sum(own * x, axis=1).astype(np.float32)
        self._contrast_moment = np.sum(own * x * lights, axis=1).astype(np.float32)

    def _prepare_code(self):
        last = self.pixels - 1 - self._half
        reach = int(np.interp(last, np.arange(self.pixels), self._place) + 0.5)
        if 2 * reach < _FEWEST:
            raise ValueError(
                f'{self.pixels} pixels at {self.params.bar_pitch:g} px a bar show {2 * reach} '
                f'whole bars: {_FEWEST} are needed to tell place and direction')
        self._rank = np.arange(-reach, reach + 1)
        n, bits = len(self._rank), self.disc.bits
        windows = np.roll(windows_of(bits, n), reach, axis=0).astype(np.int64)
        # doubled, for they meet halves: a product counts equal less unequal bits
        self._signs = np.ascontiguousarray((4.0 * windows - 2.0).T.astype(np.float32))
        before, after = np.roll(bits, 1).astype(np.int64), np.roll(bits, -1)
        combo = np.roll(windows_of(4 * before + 2 * bits + after, n), reach, axis=0)
        # for a window with its middle at each bar: bits, and what undisturbed bars show
        self._narrow = windows.astype(bool)
        self._expected = np.stack(
            [table[combo] for table in (
                1.0 / self._contrast_of, self._level_of, self._response, self._response_slope,
                self._ground_moment, self._contrast_moment)], axis=1).astype(np.float32)

        self._rank32 = rank = self._rank.astype(np.float32)
        self._powers = np.stack([np.ones(n, np.float32), rank, rank * rank], axis=1)
        # least-squares parabola through a row of values: the values on it, and their slope
        fit = np.linalg.pinv(self._powers.astype(float))
        smooth = self._powers @ fit
        slope = np.stack([np.zeros(n), np.ones(n), 2.0 * rank], axis=1) @ fit
        self._smooth = np.ascontiguousarray(smooth.T.astype(np.float32))
        self._smooth_slope = np.ascontiguousarray(slope.T.astype(np.float32))

        # bits of evidence in `wrong` of `count` bars, against all places and both directions
        evidence = np.full((n + 1, n + 1), -np.inf)
        for count in range(n + 1):
            ways = np.cumsum([math.comb(count, k) for k in range(count + 1)])
            evidence[count, : count + 1] = count - np.log2(ways) - np.log2(2.0 * self.disc.bars)
        self._evidence = evidence

    # --- reading ------------------------------------------------------------------------------

    def read(self, frames):
        """Read frames.

        Parameters
        ----------
        frames : ndarray, shape (n, pixels)
            Grey levels as the CCD delivers them, bars dark.

        Returns
        -------
        TemplateReadings

        Raises
        ------
        ValueError
            Wrong number of pixels.
        """
        frames = checked_frames(frames, self.pixels)
        if len(frames) == 0:
            kinds = (float, np.int8, np.int8, bool, np.int64, np.int64, float)
            return TemplateReadings(*(np.empty(0, dtype=kind) for kind in kinds))
        # a frame that is no image leads to numbers that are none: it is rejected in the end
        with np.errstate(all='ignore'):
            parts = [self._read(frames[i : i + _CHUNK])
                     for i in range(0, len(frames), _CHUNK)]
        if len(parts) == 1:
            return TemplateReadings(*parts[0])
        return TemplateReadings(*(np.concatenate(column) for column in zip(*parts)))

    def _read(self, frames):
        """The fields of TemplateReadings; the other direction is tried where the code fails."""
        turned = self.direction == 'reversed' or self.direction == 'detect' and self._backwards
        fields = self._read_one_way(frames[:, ::-1] if turned else frames)
        reason = fields[2]
        fields[3][:] = turned
        failed = reason == _NOT_ON_DISC
        if failed.any():
            # all of them: the last digit depends on how many are read at once
            again = self._read_one_way(frames if turned else frames[:, ::-1])
            rows = np.flatnonzero(failed & (again[2] == 0))
            if self.direction != 'detect':
                reason[rows] = _WRONG_DIRECTION
            else:
                again[3][:] = not turned
                for field, values in zip(fields, again):
                    field[rows] = values[rows]
                # only the speed depends on which is tried first
                self._backwards ^= len(rows) > 0.5 * len(frames)
        return fields

    def _read_one_way(self, frames):
        n = len(frames)
        grey = np.ascontiguousarray(frames, dtype=np.float32)
        spoilt = None
        if frames.dtype != np.uint8:
            spoilt = ~np.isfinite(grey).all(axis=1)
            if spoilt.any():
                grey = np.where(spoilt[:, np.newaxis], np.float32(0.0), grey)
        alpha, beta = self._phase(grey)
        pixel, shift, visible = self._bar_pixels(alpha, beta)
        seen, unlike = self._project(grey, pixel)
        bars = visible.sum(axis=1)

        contrast = seen[1] + seen[2]
        typical = _median(contrast)
        legible, narrow = self._bits(seen, unlike, contrast, visible)
        bar, score, count, reason = self._find(legible, narrow, bars)
        expected = self._narrow[bar]
        alpha_change, beta_change, weight, spread = self._fit(
            _Bars(seen=seen, contrast=contrast, typical=typical, visible=visible, pixel=pixel,
                  shift=shift, narrow=expected, good=legible & (narrow == expected)),
            self._expected[bar])
        spread = spread[:, 0]
        alpha, beta = alpha + alpha_change[:, 0], beta + beta_change[:, 0]
        used = (weight > 0.0).sum(axis=1)

        fine = used >= self.MIN_SHARE * bars
        fine &= spread <= self.MAX_SCATTER
        fine &= np.abs(beta) <= self.MAX_SCALE
        fine &= np.abs(alpha_change[:, 0]) <= 0.25
        if not fine.all():
            reason[~fine & (reason == 0)] = _OUT_OF_LINE
        clear = typical[:, 0] >= self.MIN_CONTRAST
        if not clear.all():
            reason[~clear] = _NO_CONTRAST
        bright = grey.max(axis=1) >= 255.0
        if bright.any():
            bright = np.flatnonzero(bright)
            share = np.mean(grey[bright] >= 255.0, axis=1)
            reason[bright[share > self.MAX_SATURATED]] = _SATURATED
        if spoilt is not None:
            reason[spoilt] = _NOT_FINITE

        around = self.disc.bars
        place = (bar - alpha.astype(float) / (1.0 + beta)) % around
        place[place >= around] = 0.0  # a hair below a full turn is rounded up to it
        angle = place * self.disc.bar_angle
        sigma = spread * self.disc.bar_angle / np.sqrt(used)
        wrong = bars - (count + score) // 2
        quality = (wrong > 0).astype(np.int8)
        rejected = reason > 0
        if rejected.any():
            angle[rejected] = sigma[rejected] = np.nan
            quality[rejected] = REJECTED
        return angle, quality, reason, np.zeros(n, dtype=bool), wrong, used, sigma

    def _phase(self, grey):
        """Where the lattice of bars lies: place of bar 0 in bars, and relative scale error.

        Bar 0 is the one nearest to the middle of the row.
        """
        waves = (grey @ self._waves).view(np.complex64)
        # only their phase counts, so that a blob weighs no more than the bars that it hides
        waves /= np.maximum(np.abs(waves), _TINY)
        left, middle, right = (np.abs(waves @ self._tries) ** 2).T
        curve = np.minimum(left + right - 2.0 * middle, -_TINY)
        scale = (0.5 * _TRY) * (left - right) / curve
        scale = np.minimum(np.maximum(scale, -2.0 * _TRY), 2.0 * _TRY)
        waves *= np.exp(1j * (scale[:, np.newaxis] * self._turns))
        total = waves.sum(axis=1)
        return np.arctan2(total.imag, total.real) * (-1.0 / _TURN) * (1.0 + scale), scale

    def _bar_pixels(self, alpha, beta):
        """Nearest pixel to each bar, how far the bar is beyond it, and whether it is in the row."""
        place = alpha[:, np.newaxis] + self._rank32 * (1.0 + beta[:, np.newaxis])
        if self._flat:
            exact = np.interp(place, self._place, np.arange(self.pixels), -1.0, self.pixels)
        else:
            exact = place * np.float32(self.params.bar_pitch) + np.float32(0.5 * (self.pixels - 1))
        pixel = np.rint(exact)
        inside = np.minimum(np.maximum(pixel, self._half), self.pixels - 1 - self._half)
        return inside.astype(np.int64), (exact - pixel).astype(np.float32), inside == pixel

    def _project(self, grey, pixel):
        """The stretch of the row about each bar.

        Returns
        -------
        seen : ndarray, shape (columns, n, bars)
            Its products with the columns.
        unlike : ndarray, shape (n, bars)
            Mean square of what neither a wide nor a narrow bar explains.
        """
        n, length = len(grey), 2 * self._half + 1
        # every stretch of the rows, without a copy
        stretches = np.ndarray((n, self.pixels - length + 1, length), np.float32, grey, 0,
                               (*grey.strides, grey.strides[1]))
        cells = stretches[np.arange(n)[:, np.newaxis], pixel - self._half].reshape(-1, length)
        seen = self._columns @ cells.T
        explained = self._explained @ seen[:3]
        inner = cells[:, self._inner]
        unlike = np.einsum('ij,ij->i', inner, inner)
        unlike -= np.einsum('ij,ij->j', explained, explained)
        unlike /= inner.shape[1]
        return seen.reshape(-1, *pixel.shape), unlike.reshape(pixel.shape)

    def _bits(self, seen, unlike, contrast, visible):
        """Which bars look like bars, and which of them like narrow ones, shape (n, bars)."""
        level = seen[0]
        # contrast that a bar has at this level: shading changes both alike
        usual = _median(contrast / np.maximum(level, 1.0)) * level
        difference = seen[2] - seen[1]
        narrow = difference > 0.0
        legible = visible & (np.abs(contrast - 1.05 * usual) < 0.45 * usual)
        middle, reach = self._share
        legible &= np.abs(np.abs(difference) - middle * contrast) < reach * contrast
        legible &= unlike < (self._unlike * usual) ** 2 + 2.0 * _median(unlike)
        # a bar that is out of place looks wider or narrower than it is
        legible &= np.abs(np.where(narrow, seen[7], seen[3])) < self._displaced * contrast
        dirty = (legible != visible).any(axis=1)
        if dirty.any():
            # near a blob, of which part is in the stretch, the ground is lower than elsewhere
            rows = np.flatnonzero(dirty)
            good, level = legible[rows], level[rows]
            middle = _median(level)
            good &= level > 0.25 * middle
            curve = np.where(good, level, middle)
            for _ in range(4):
                curve = np.where(good, level, curve @ self._smooth)
            curve = curve @ self._smooth
            legible[rows] = good & (np.abs(level - curve) < _UNLIKE * curve)
        return legible, narrow

    def _find(self, legible, narrow, bars):
        """Number of bar 0 on the disc, equal less unequal bits, bits compared, and reason."""
        signs = np.subtract(narrow, _HALF, dtype=np.float32)
        signs *= legible
        match = signs @ self._signs
        bar = match.argmax(axis=1)
        score = match[np.arange(len(bar)), bar].astype(np.int64)
        count = legible.sum(axis=1)
        reason = np.zeros(len(bar), dtype=np.int8)
        doubtful = score < bars
        if not doubtful.any():
            return bar, score, count, reason  # and any two windows of the disc differ
        wrong = (count - score) // 2
        needed = np.where(wrong > 0, self.MIN_EVIDENCE, self.MIN_EVIDENCE_EXACT)
        reason[self._evidence[count, wrong] < needed] = _NOT_ON_DISC
        doubtful = np.flatnonzero(doubtful & (reason == 0))
        others = match[doubtful]
        others[np.arange(len(doubtful)), bar[doubtful]] = -np.inf
        margin = score[doubtful] - others.max(axis=1)
        reason[doubtful[margin < 2 * self.MIN_MARGIN]] = _AMBIGUOUS
        return bar, score, count, reason

    def _fit(self, bars, expected):
        """Steps 4 and 5: change of the line ``alpha + beta * rank`` of the bars' places.

        Returns
        -------
        alpha, beta : ndarray, shape (n, 1)
            Bar periods, and relative.
        weight : ndarray, shape (n, bars)
        spread : ndarray, shape (n, 1)
            1-sigma of a bar about the line, bar periods.
        """
        from_contrast, from_level, response, slope, ground_moment, contrast_moment = (
            expected[:, k] for k in range(6))
        curves = np.empty((2, *bars.good.shape), dtype=np.float32)
        np.multiply(bars.contrast, from_contrast, out=curves[1])
        np.multiply(curves[1], from_level, out=curves[0])
        curves[0] += bars.seen[0]
        curves, good = self._smooth_curves(curves, bars.good)
        bars.contrast_curve = contrast = curves[1] @ self._smooth
        level_slope, contrast_slope = curves @ self._smooth_slope

        bars.per_pixel = self._scale[bars.pixel]
        level_slope *= ground_moment
        contrast_slope *= contrast_moment
        level_slope -= contrast_slope
        level_slope *= bars.per_pixel
        level_slope -= contrast * response
        bars.ground = level_slope
        bars.series = np.where(bars.narrow, bars.seen[7:11], bars.seen[3:7])
        slope = contrast * slope
        bars.weight = slope * good
        bars.scale = bars.per_pixel / slope
        return self._find_line(bars, bars.shift, None, self._PASSES - 1)

    def _find_line(self, bars, shift, crosstalk, more):
        """The line when the template of each bar lies at `shift`, and `more` times anew from it."""
        m0, m1, m2, m3 = bars.series
        # the weights moved by `shift`, as a series
        rest = bars.ground - (m0 - shift * (m1 - shift * (m2 - shift * m3)))
        if crosstalk is not None:
            rest -= crosstalk
        rest *= bars.scale
        alpha, beta, weight, spread, left = self._line(rest, bars.weight, crosstalk is None)
        if more:
            # anew where the line has moved, or bars that are off it disturb their neighbours
            off = bars.visible & (weight == 0.0)
            again = off.any(axis=1)
            again |= (np.abs(alpha) + np.abs(beta) * self._rank32[-1] > self._enough)[:, 0]
            if again.any():
                rows = np.flatnonzero(again)
                part = bars.rows(rows)
                line = alpha[rows] + beta[rows] * self._rank32
                crosstalk = self._crosstalk(left[rows] / part.per_pixel, off[rows], part)
                a, b, weight[rows], spread[rows] = self._find_line(
                    part, shift[rows] + line / part.per_pixel, crosstalk, more - 1)
                alpha[rows] += a
                beta[rows] += b
        return alpha, beta, weight, spread

    def _smooth_curves(self, curves, good):
        """Level and contrast along the row, with bars that are not on a parabola put on it.

        Returns
        -------
        curves : ndarray, shape (2, n, bars)
        good : ndarray of bool, shape (n, bars)
            Those that were on both.
        """
        if not good.all():
            # a bar at an end is often cut: there the next one stands for it
            curves[:, :, 0] = np.where(good[:, 0], curves[:, :, 0], curves[:, :, 1])
            curves[:, :, -1] = np.where(good[:, -1], curves[:, :, -1], curves[:, :, -2])
            dirty = ~good[:, 1:-1].all(axis=1)
            if dirty.any():
                rows = np.flatnonzero(dirty)
                part, on = curves[:, rows], good[rows]
                part = np.where(on, part, _median(part))
                for _ in range(3):
                    part = np.where(on, part, part @ self._smooth)
                curves[:, rows] = part
        rest = np.abs(curves - curves @ self._smooth)
        clean = rest <= _OUTLIER * _median(rest) + _FLAT * curves
        if not clean.all():
            clean = clean[0] & clean[1]
            rows = np.flatnonzero(~clean.all(axis=1))
            good = good & clean
            part, on = curves[:, rows], good[rows]
            for _ in range(3):
                part = np.where(on, part, part @ self._smooth)
            curves[:, rows] = part
        return curves, good

    def _line(self, values, weight0, from_median):
        """Robust straight line: Tukey's weights, from the median or else from zero on."""
        rest = values - _median(values) if from_median else values
        for _ in range(2):
            cut = _median(np.abs(rest)) * (1.4826 * _CUT) + _TINY
            weight = rest / cut
            weight *= weight
            np.subtract(1.0, weight, out=weight)
            np.maximum(weight, 0.0, out=weight)
            weight *= weight
            weight *= weight0
            s = weight @ self._powers
            t = (weight * values) @ self._powers[:, :2]
            s0, s1, s2 = s[:, 0:1], s[:, 1:2], s[:, 2:3]
            t0, t1 = t[:, 0:1], t[:, 1:2]
            det = s0 * s2 - s1 * s1 + _TINY
            alpha = (s2 * t0 - s1 * t1) / det
            beta = (s0 * t1 - s1 * t0) / det
            rest = values - alpha - beta * self._rank32
        return alpha, beta, weight, cut * (1.0 / _CUT), rest

    def _crosstalk(self, apparent, off, bars):
        """What bars that are not at their place, or not there, change in the response of others.

        Parameters
        ----------
        apparent : ndarray, shape (n, bars)
            Distance from the line, pixels, as if the response were linear.
        off : ndarray of bool, shape (n, bars)
            Which bars.
        bars : _Bars
        """
        level = bars.seen[0]
        missing = off & (np.abs(bars.contrast) < 0.25 * bars.typical) & (level > _median(level))
        # level and contrast of a bar, not of a blob
        ratio = bars.contrast / np.maximum(level, 1.0)
        shifted = off & (np.abs(ratio / _median(ratio) - 1.0) < 0.12)
        out = np.zeros_like(apparent)
        row, bar = np.nonzero(shifted | missing)
        kind = bars.narrow[row, bar].astype(np.int64)
        apparent = apparent[row, bar]
        shift = np.where(kind > 0, np.interp(apparent, self._apparent[1], self._shifts),
                         np.interp(apparent, self._apparent[0], self._shifts))
        gone = missing[row, bar]
        middle = len(self._shifts) // 2
        step = self._shifts[1] - self._shifts[0]
        for side in (-1, 1):
            # the bar is the neighbour to the `side` of another one
            other = bar - side
            inside = (other >= 0) & (other < out.shape[1])
            r, o, k = row[inside], other[inside], kind[inside]
            table = self._neighbour[bars.narrow[r, o].astype(np.int64), k]
            at = np.clip(side * shift[inside] / step + middle, 0.0, 2 * middle - 1e-6)
            low = at.astype(np.int64)
            n = np.arange(len(r))
            value = table[n, low] + (at - low) * (table[n, low + 1] - table[n, low])
            value = np.where(gone[inside], 0.0, value) - table[:, middle]
            out[r, o] += side * value
        return out * bars.contrast_curve


class _Bars:
    """What is known of the bars of n frames; arrays of shape (n, bars) unless said.

    Attributes
    ----------
    visible, good : ndarray of bool
        Whole in the row; legible, and as the code has it.
    narrow : ndarray of bool
        By the code.
    pixel, shift : ndarray
        Middle of the stretch, and how far the bar is expected beyond it, pixels.
    seen : ndarray, shape (columns, n, bars)
    contrast : ndarray
    typical : ndarray, shape (n, 1)
        Contrast of the frame.
    contrast_curve, per_pixel, ground, scale, weight : ndarray
        Set by `_fit`: contrast along the row; bar periods a pixel; response of a bar at its place
        to a template at its place; bar periods a unit of response; weight of the bar.
    series : ndarray, shape (4, n, bars)
        Terms of the response to a moved template.
    """

    _FIRST = ('visible', 'good', 'narrow', 'pixel', 'shift', 'contrast', 'typical',
              'contrast_curve', 'per_pixel', 'ground', 'scale', 'weight')
    _SECOND = ('seen', 'series')

    def __init__(self, **fields):
        self.__dict__.update(fields)

    def rows(self, rows):
        """Those of some frames."""
        if len(rows) == len(self.visible):
            return self
        return _Bars(**{name: getattr(self, name)[rows] for name in self._FIRST},
                     **{name: getattr(self, name)[:, rows] for name in self._SECOND})


def _median(values):
    """Median along the last axis, of odd length, which is kept with length 1."""
    middle = values.shape[-1] // 2
    return np.partition(values, middle, axis=-1)[..., middle : middle + 1]
