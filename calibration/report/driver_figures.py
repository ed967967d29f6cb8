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

"""Figures of the effects found, and of residuals, against their drivers."""

from itertools import pairwise

import numpy as np

from pointing_model.effects.base import arcsec
from pointing_model.rms import rms

from . import page_parts as page
from .drawing import MAX_NAMED, Panel, limit_of, padded, svg
from .error_ranking import MOST_ERRORS

#: largest number of rows linked in the figures, and number of drivers not folded away
_LINKED, _MOST = 300, 6


def effects_section(view):
    """Section on the effects: partial residuals, causes and formula of each."""
    left = len(view.effects) - MOST_ERRORS
    more = f'{left} smaller ones: in the JSON result.' if left > 0 else ''
    return page.folded_section(
        'Effects', [_effect(view, one) for one in view.effects[:MOST_ERRORS]],
        ' '.join(filter(None, [view.axes_note, more])))


def largest_effect(view):
    """Figure of the first effect, in the axis where it is larger; None without effect or driver."""
    if not view.effects:
        return None
    size = np.sqrt(np.nansum(np.square(view.effects[0].own), axis=1))
    return effect_figure(view, view.effects[0], (int(np.argmax(size)),))[0]


def _effect(view, effect):
    figure, axes = effect_figure(view, effect)
    kind = 'effect one' if axes == 1 else 'effect'
    return page.subsection(effect.name, page.block([
        page.block([_causes(effect.causes), page.definitions(effect.facts)]), figure], kind))


def _causes(rows):
    """Table of likely causes of an effect: evidence, coefficients, what to check."""
    rows = [list(row) for row in rows]
    for before, row in reversed(list(pairwise(rows))):
        if row[-1] and row[-1] == before[-1]:
            row[-1] = 'the same'
    return page.table(('cause', 'ΔBIC', 'coefficients ″', 'check'), rows, 'folding stack')


def effect_figure(view, effect, axes=(0, 1)):
    """Partial residuals without this effect alone, and it, against its driver; number of axes."""
    driver = effect.driver
    if driver is None:
        return None, 0
    data, own = view.residuals, effect.own
    x, used = _spread(driver), data.used & np.isfinite(own).all(axis=0)
    out = []
    for axis in axes:
        title = data.axes[axis]
        if not np.any(np.abs(effect.fitted[axis][used]) > 1e-9):
            continue
        fitted = own[axis]
        partial = data.after[axis] + fitted
        limit = limit_of(partial[used], fitted[used])
        panel = _panel(driver, 26, 190, limit, driver.label, 'residual [arcsec]', title)
        names = [data.names[i] for i in np.flatnonzero(used)] if used.sum() <= MAX_NAMED else None
        panel.points(x[used], partial[used], 'before', names)
        panel.dashes(x[used], fitted[used], 'fit', 26.0 if driver.levels else 7.0)
        out.append(svg(420, 262, panel.parts, f'{effect.name}, {title}'))
    if not out:
        return None, 0
    return page.figure(
        out[0] if len(out) == 1 else page.figure_pair(out),
        f'{effect.name}: strokes, {arcsec(float(rms(*own[:, used])))} RMS; dots: with the '
        f'residual{_how_to_read(driver, effect)}.'), len(out)


def _how_to_read(driver, effect):
    """Addition to the caption for a driver with few values."""
    return ', spread sideways' * bool(driver.levels) + ' (smaller higher up)' * bool(
        driver.levels and effect.fades)


def drivers_section(view):
    """Residuals of both axes against all drivers; only the first ones are not folded away."""
    drawn = [driver_figure(view, driver) for driver in view.drivers]
    marks = page.legend((*page.MARKS, *[('fit', 'effects')] * view.changed))
    return page.folded_section('Residuals by driver', [
        marks, drawn[:_MOST], page.folded(f'{len(drawn) - _MOST} more drivers', drawn[_MOST:])],
        '' if view.effects else view.axes_note)


def driver_figure(view, driver):
    """Residuals of both axes against one driver: before with the fit, and after below."""
    out = []
    x, data = _spread(driver), view.residuals
    used = data.used
    linked = len(data) <= _LINKED
    keys = [data.keys[i] for i in np.flatnonzero(used)] if linked else None
    for axis, title in enumerate(data.axes):
        before, after = data.before[axis], data.after[axis]
        limit = limit_of(before[used], after[used])
        top = _panel(driver, 24, 120, limit, '', '[″]', title)
        low = _panel(driver, 156, 120, limit, driver.label, '[″]', '')
        for panel, values, when in ((top, before, 'before'), (low, after, 'after')):
            panel.points(x[used], values[used], when, keys=keys,
                         moves=f' data-when="{when}"{panel.moving((None, axis))}' * linked)
        if view.changed:
            top.dashes(x[used], (before - after)[used], 'fit')
        out.append(svg(420, 320, [*top.parts, *low.parts], f'Residual, {title}, {driver.label}',
                       'link'))
    missing = int((~np.isfinite(driver.values[used])).sum())
    return page.figure(page.figure_pair(out), f'Unknown in {missing} rows.' if missing else '')


def _spread(driver):
    """Values to draw; with few levels they are spread sideways."""
    if not driver.levels:
        return driver.values
    return driver.values + 0.28 * (np.modf(np.arange(len(driver.values)) * 0.618)[0] - 0.5) * 2


def _panel(driver, top, height, limit, x_label, y_label, title):
    """Empty panel with axes for residuals up to a limit against a driver."""
    places = texts = None
    span = padded(driver.values, 0.03)
    if driver.levels:
        places = sorted(driver.levels)
        texts, span = [driver.levels[k] for k in places], (places[0] - 0.5, places[-1] + 0.5)
    panel = Panel((58, top, 350, height), span, (-limit, limit))
    panel.axes(x_label, y_label, title, places, texts)
    return panel
