"""The ideal image of a disc on a linear CCD: what renderer and reader both have to know."""

import math

import numpy as np

#: paper 001, eq. 4: inverted grey level = 250 - grey level
INVERSION = 250.0


def pixel_places(design, bars):
    """Place on the track that each pixel looks at, in bar periods from the middle of the row.

    Parameters
    ----------
    design : design.Design
    bars : int
        Of the disc.

    Returns
    -------
    ndarray, shape (pixels,)
        Rising with the disc angle.
    """
    offset = np.arange(design.pixels) - 0.5 * (design.pixels - 1)
    return along_track(offset / design.bar_pitch, design.geometry, bars)


def along_track(offset, geometry, bars):
    """Bar periods along the circle of offsets in periods along the row.

    Parameters
    ----------
    offset : ndarray
        From the middle of the row.
    geometry : {'arc', 'tangent'}
        The row is bent along the circle, or flat and touches it in its middle.
    bars : int
        Of the disc.
    """
    if geometry == 'tangent':
        radius = bars / (2.0 * math.pi)
        return radius * np.arctan(offset / radius)
    return offset


def blurred_bar(distance, half_width, blur):
    """Light 0..1 of a bar behind a Gaussian blur, at distances from its centre, in pixels."""
    erf = np.frompyfunc(math.erf, 1, 1)
    root = math.sqrt(2.0) * blur
    edges = erf((distance + half_width) / root) - erf((distance - half_width) / root)
    return 0.5 * edges.astype(float)


def half_widths(design, bars):
    """Half width of a wide ('0') and of a narrow bar ('1'), nominal pixels."""
    scale = design.bar_pitch / (math.pi * design.diameter / bars)  # pixels a metre on the circle
    return 0.5 * design.bar_wide * scale, 0.5 * design.bar_narrow * scale
