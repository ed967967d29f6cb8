"""What people see of a calibration: tables on the terminal and a picture."""

import numpy as np

from msg_tools.units import ARCSEC, DEG
from pointing_model.catalogue import POLARIS_HIP
from pointing_model.rms import rms, rms_arcsec
from pointing_model.zero import Zeros

from .session import RAW


def new_table(title, *columns):
    """An empty `rich` table, first column left, the others right; its title may be the widest."""
    from rich import box
    from rich.table import Table
    out = Table(title=title, box=box.SIMPLE_HEAD, title_justify='left', title_style='bold',
                pad_edge=False, min_width=len(title) + 2)
    for i, name in enumerate(columns):
        out.add_column(name, justify='left' if i == 0 else 'right', no_wrap=True)
    return out


def _angle(value, sigma):
    return f'{value:+9.2f} ± {sigma:.2f}'


def night_tables(report):
    """The tables of a calibration report.

    Parameters
    ----------
    report : dict
        From `calibration.session.CalibrationSession.fit`.

    Returns
    -------
    list of rich.table.Table
    """
    tables = []
    if report['zeros']:
        zeros = new_table(
            'Zero on Polaris, arcsec', 'power-on', 'azimuth', 'elevation', 'exposures')
        for zero in report['zeros']:
            zeros.add_row(f'{zero["run"]}', *_zero_cells(zero))
        for change in report['changes']:
            zeros.add_row(f'change {change["from"]} to {change["to"]}', *_zero_cells(change))
            truth = change.get('simulated')
            if truth:
                zeros.add_row('  simulated', f'{truth["az_arcsec"]:+9.2f}       ',
                              f'{truth["el_arcsec"]:+9.2f}       ', '')
        tables.append(zeros)
    steps = new_table('RMS on the sky, arcsec', 'correction', 'used: az', 'el', 'radial',
                      'held out: az', 'el', 'radial')
    for step in report['steps']:
        steps.add_row(step['step'], *_rms_cells(step['used']), *_rms_cells(step['held_out']))
    tables.append(steps)
    if report['external_check']:
        check = new_table('External check, RMS on the sky, arcsec', 'model and stars', 'az', 'el',
                      'radial', 'stars')
        for row in report['external_check']:
            check.add_row(row['check'], *_rms_cells(row), str(row['n']))
        tables.append(check)
    tables.append(terms_table(report['terms']))
    return tables


def _zero_cells(zero):
    return (_angle(zero['az_arcsec'], zero['sigma_az_arcsec']),
            _angle(zero['el_arcsec'], zero['sigma_el_arcsec']), str(zero['exposures']))


def _rms_cells(values):
    return [f'{values[key]:.2f}' for key in ('x', 'y', 'radial')]


def terms_table(terms):
    """A table of terms with their standard errors.

    Parameters
    ----------
    terms : list of dict
        With ``name``, ``value_arcsec``, ``sigma_arcsec``.

    Returns
    -------
    rich.table.Table
    """
    out = new_table('Terms, encoder − catalogue, arcsec', 'term', 'value', 'sigma')
    for term in terms:
        out.add_row(term['name'], f'{term["value_arcsec"]:+.2f}', f'{term["sigma_arcsec"]:.2f}')
    return out


def fit_tables(run, result, encoder='enc', held_out=None):
    """The tables of a fit to a measured run.

    Parameters
    ----------
    run : PointingRun
    result : calibration.fit.FitResult
    encoder : {'enc', 'abs'}
        The pair of encoder columns that was fitted.
    held_out : Rms, optional
        Of rows that the fit did not see.

    Returns
    -------
    list
        What `rich.console.Console.print` takes: tables and lines of text.
    """
    steps = new_table(
        f'RMS on the sky, arcsec, {len(run)} rows', 'correction', 'az', 'el', 'radial')
    steps.add_row(RAW, *_rms_cells(rms_arcsec(*run.offsets(encoder))._asdict()))
    steps.add_row(f'{len(result.names)} terms, on the rows fitted',
                  *_rms_cells(result.rms_arcsec()._asdict()))
    if held_out is not None:
        steps.add_row(f'{len(result.names)} terms, each half judged by a fit to the other',
                      *_rms_cells(held_out._asdict()))
    lines = [f'sigma from the {result.covariance_from.removeprefix("measured ")}'
             f'{"" if result.covariance_from == "given sigmas" else " of the residuals"}; '
             f'condition {result.condition:.0f}, rank {result.rank} of {len(result.names)}']
    strong = _strong_correlations(result)
    if strong:
        lines.append(f'correlations above 0.9: {strong}')
    if len(result.rejected):
        lines.append(f'{len(result.rejected)} rows had no weight in the robust fit')
    for dropped in result.dropped:
        lines.append(f'the stars do not determine {dropped["text"]}')
    for row in [*run.meta.get('excluded', []), *result.excluded]:
        lines.append(f'row {row["row"]} left out: {row["reason"]}')
    lines += [f'note: {note}' for note in run.meta.get('notes', [])]
    return [terms_table(result.term_rows()), steps, *lines]


def _strong_correlations(result):
    matrix = result.correlations
    return ', '.join(
        f'{a} {b} {matrix[i, j]:+.3f}' for i, a in enumerate(result.names)
        for j, b in enumerate(result.names[:i]) if abs(matrix[i, j]) > 0.9)


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
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    stars = run.select((run['star'] >= 0) & (run['star'] != POLARIS_HIP))
    zeros = Zeros.from_list(report['zeros_in_force'])
    before = [v / ARCSEC for v in stars.offsets()]
    after = [v / ARCSEC for v in model.residuals(stars, zero=zeros)]

    figure = Figure(figsize=(11.0, 8.5), layout='constrained')
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(2, 2, height_ratios=[1.35, 1.0])
    for column, (title, (x, y)) in enumerate((('Before: as the encoders read', before),
                                              ('After: zero and model', after))):
        _sky(figure.add_subplot(grid[0, column], projection='polar'), stars, x, y, title)
    elevation, azimuth = stars['el'] / DEG, np.mod(stars['az'], 2.0 * np.pi) / DEG
    for column, (name, place, unit) in enumerate((
            ('azimuth', azimuth, 'azimuth [°]'), ('elevation', elevation, 'elevation [°]'))):
        axes = figure.add_subplot(grid[1, column])
        axes.axhline(0.0, color='0.6', lw=0.8)
        axes.plot(place, after[0], 'o', ms=4, label='azimuth × cos E')
        axes.plot(place, after[1], 's', ms=4, label='elevation')
        axes.set_xlabel(unit)
        axes.set_ylabel('residual after [arcsec]')
        axes.set_title(f'After the model, against {name}', fontsize=10)
        if column == 0:
            axes.legend(fontsize=8, ncols=2)
    figure.suptitle('Pointing offsets, encoder − catalogue, on the sky')
    figure.savefig(path, dpi=110)


def _sky(axes, stars, x, y, title):
    """Arrows of the offsets on the sky seen from above, north up and east to the right."""
    axes.set_theta_zero_location('N')
    axes.set_theta_direction(-1)
    az, distance = stars['az'], 90.0 - stars['el'] / DEG
    # to east and north in the drawing: +A turns clockwise, +E points to the middle
    east = x * np.cos(az) - y * np.sin(az)
    north = -x * np.sin(az) - y * np.cos(az)
    radial = rms(x, y)
    scale = 10.0 / max(radial, 1e-9)
    axes.quiver(az, distance, east * scale, north * scale, angles='uv', scale_units='dots',
                scale=0.5, width=0.004, color='tab:blue')
    axes.plot(az, distance, '.', ms=3, color='0.3')
    axes.set_rlim(0.0, 75.0)
    axes.set_rgrids([30.0, 60.0], ['60°', '30°'], fontsize=7, color='0.5')
    axes.set_title(f'{title}\nradial RMS {radial:.2f}″ (arrow of that length: 20 px)', fontsize=10)
