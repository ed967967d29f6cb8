"""What people see of a night: its residuals on the sky and by axis, as a picture."""

import numpy as np

from msg_tools.units import ARCSEC, DEG
from pointing_model.mounts import ALTAZ
from pointing_model.rms import rms
from pointing_model.zero import Zeros
from pointing_model.zero_exposures import is_for_zero


def plot_night(run, model, report, path):
    """Residual vectors on the sky before and after, and per axis.

    Parameters
    ----------
    run : PointingRun
        All observations of the night.
    model : PointingModel
        Fitted to them.
    report : dict
        The calibration report, for the zeros.
    path : str or Path
        PNG to write.
    """
    from matplotlib.figure import Figure

    stars = run.select((run['star'] >= 0) & ~is_for_zero(run))
    zeros = Zeros.from_list(report['zeros_in_force'])
    before = [v / ARCSEC for v in stars.offsets()]
    after = [v / ARCSEC for v in model.residuals(stars, zero=zeros)]

    figure = Figure(figsize=(11.0, 8.5), layout='constrained')
    grid = figure.add_gridspec(2, 2, height_ratios=[1.35, 1.0])
    for column, (title, (x, y)) in enumerate((('Before: as the encoders read', before),
                                              ('After: zero and model', after))):
        _sky(figure.add_subplot(grid[0, column], projection='polar'), stars, x, y, title)
    names = stars.mount.names
    first = np.mod(stars['az'], 2.0 * np.pi) if stars.mount.altaz else stars['az']
    for column, (name, place) in enumerate(zip(names.axes, (first / DEG, stars['el'] / DEG))):
        axes = figure.add_subplot(grid[1, column])
        axes.axhline(0.0, color='0.6', lw=0.8)
        axes.plot(place, after[0], 'o', ms=4, label=f'{names.axes[0]} × cos {names.letters[1]}')
        axes.plot(place, after[1], 's', ms=4, label=names.axes[1])
        axes.set_xlabel(f'{name} [°]')
        axes.set_ylabel('residual after [arcsec]')
        axes.set_title(f'After the model, against {name}', fontsize=10)
        if column == 0:
            axes.legend(fontsize=8, ncols=2)
    figure.suptitle('Pointing offsets, encoder − catalogue, on the sky')
    figure.savefig(path, dpi=110)


def _on_horizon(stars, x, y):
    """Azimuth and elevation, and offsets along them."""
    mount = stars.mount
    if mount.altaz:
        return stars['az'], stars['el'], x, y
    az, el = mount.horizon_of(stars['az'], stars['el'])
    moved = sum(v * along for v, along in zip((x, y), mount.tangents(stars['az'], stars['el'])))
    return az, el, *(np.sum(moved * along, axis=0) for along in ALTAZ.tangents(az, el))


def _sky(axes, stars, x, y, title):
    """Arrows of the offsets on the sky seen from above, north up and east to the right."""
    axes.set_theta_zero_location('N')
    axes.set_theta_direction(-1)
    radial, (az, el, x, y) = rms(x, y), _on_horizon(stars, x, y)
    distance = 90.0 - el / DEG
    # to east and north in the drawing: +A turns clockwise, +E points to the middle
    east = x * np.cos(az) - y * np.sin(az)
    north = -x * np.sin(az) - y * np.cos(az)
    scale = 10.0 / max(radial, 1e-9)
    axes.quiver(az, distance, east * scale, north * scale, angles='uv', scale_units='dots',
                scale=0.5, width=0.004, color='tab:blue')
    axes.plot(az, distance, '.', ms=3, color='0.3')
    axes.set_rlim(0.0, 75.0)
    axes.set_rgrids([30.0, 60.0], ['60°', '30°'], fontsize=7, color='0.5')
    axes.set_title(f'{title}\nradial RMS {radial:.2f}″ (arrow of that length: 20 px)', fontsize=10)
