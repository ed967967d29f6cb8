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

"""The closed loop: a night or a measured run is fitted, diagnosed, corrected and validated."""

import json
from fnmatch import fnmatchcase
from functools import partial

import numpy as np

from calibration.analysis.diagnosis.row_counts import reader_row_counts
from calibration.estimation.false_alarms import ALPHA
from msg_tools.units import ARCSEC, DEG
from msg_tools.whole_files import tried, write_text
from pointing_model.zero_drift import KEY as FOLLOWS
from telescope_mount.observing.plan import ZERO_EXPOSURES, parse_plan

from ..graph import measured_graph, night_graph
from ..nights.night_files import Written, diagnosing, is_log, write_files
from ..nights.whole_night import NightFailed, observe, prepare_folder
from ..simulation import kind_of_mount, scenario_names, undeclared
from .loop_outcome import outcome, paired, points_worse
from .loop_page import write_all_page, write_loop_page

FORMAT = 'telescope_mount/loop'
VERSION = 1
#: scenarios made for this command
ALL = 'loop_*'
#: number of fitted stars, and of new stars in each check; one row in this many of a run is held out
FITTED, CHECKED, CHECK_EVERY = 90, 30, 4
#: keys of a diagnosis that the report has, too
_FROM_DIAGNOSIS = (
    'verdict', 'effects', 'applied', 'published', 'refused', 'judgement', 'noise_floor_arcsec',
    'before', 'after', 'kept_out', 'expected', 'rows_read', 'rows_used', 'outliers',
    'rms_with_outliers_arcsec', 'notes')
#: steps of the run player, in the form of a plan
_MEASURED_PLAN = 'fit, diagnose'


def loop_plan(stars, polaris, check):
    """Plan of a night: measure, fit, check on blind stars, diagnose, check again, compare.

    Parameters
    ----------
    stars : int
        Number of stars for fit and diagnosis.
    polaris : int
        Number of exposures for the zero.
    check : int
        Number of new stars before and after the diagnosis.

    Returns
    -------
    str
    """
    return (f'home, stars {stars}, zero {polaris}, calibrate_zero, fit, check {check}, '
            f'diagnose, check {check}, judge')


def close_the_loop(out, *, scenario='', file=None, seed=1, stars=FITTED, polaris=ZERO_EXPOSURES,
                   check=CHECKED, check_every=CHECK_EVERY, alpha=ALPHA, start_time='', place=None,
                   sky=None, mount='', domain_number=None, progress=None):
    """Run the loop for one night with a scenario, or for one measured run.

    Parameters
    ----------
    out : Path
        Folder for all output.
    scenario : str
        Errors of the simulated mount; or
    file : Path, optional
        a measured run, of which one row in `check_every` is held out.
    stars, polaris, check : int
        See `loop_plan`.
    alpha : float
        Family-wise error rate: chance that a clean night gets any effect.
    place : dict, optional
        For the measured run, see `run_loader.load_run`: ``azimuth_origin``, ``mount``,
        ``site``, ``weather``, ``equinox``.
    seed, start_time, sky, mount, domain_number
        See `night.run_night`.
    progress : callable, optional
        Called with (text, done, total) for progress.

    Returns
    -------
    dict
        The content of ``report.json``, see `FORMAT`.

    Raises
    ------
    ValueError, OSError
        Bad input.
    NightFailed
        A node ended, or a step could not be carried out.
    """
    sky, place = sky or {}, place or {}
    if file is not None:
        # report unreadable input before any node starts
        run = _sound_run(file, place)
        progress = progress and (
            lambda text, done, _, line=progress: line(text, done, len(run)))
        plan = _MEASURED_PLAN
    else:
        run, plan = None, loop_plan(stars, polaris, check)
        parse_plan(plan)
    folder = prepare_folder(out)
    calibration = diagnosing(folder, {'alpha': alpha, 'site': _site_of(run, sky)})
    if file is not None:
        specs = measured_graph(
            bag=str(folder / 'bag'), seed=seed, calibration=calibration,
            player=_player(run, file, place.get('azimuth_origin'), folder) | {
                'check_every': check_every})
    else:
        specs = night_graph(
            bag=str(folder / 'bag'), scenario=scenario, seed=seed, start_time=start_time,
            plan=plan, sample_rate_hz=1.0, sky=sky, calibration=calibration,
            mount=kind_of_mount(scenario, mount))
    about = {'scenario': scenario or None, 'source': str(file) if file else None, 'seed': seed,
             'plan': plan}
    report, rows, _ = observe(folder, specs, plan, partial(_write, folder, about), progress,
                              domain_number)
    if file is not None:
        report['rows_read'] += reader_row_counts(run).lost
    # of a simulated night only now, after all decisions
    _add_outcome(folder, report, None if file else undeclared(folder / 'bag_truth'))
    incomplete = report.pop('incomplete')
    tried(incomplete, folder / 'report.json', partial(
        write_text, text=json.dumps(report, indent=1) + '\n'))
    tried(incomplete, folder / 'page.html', lambda path: write_loop_page(folder, report, rows))
    return report | {'incomplete': incomplete}


def close_all(out, *, names=ALL, seed=1, progress=None, **options):
    """`close_the_loop` for several scenarios, each in its own folder.

    Parameters
    ----------
    out : Path
        Folder for all output.
    names : str
        Pattern of scenario names, such as ``mount_*``.
    seed, progress, options
        See `close_the_loop`.

    Returns
    -------
    dict
        ``scenarios``: the report of each; a failed one has an ``error``.

    Raises
    ------
    ValueError, OSError
        No scenario matches, or bad input.
    """
    chosen = [name for name in scenario_names() if fnmatchcase(name, names)]
    if not chosen:
        raise ValueError(f'no scenario {names!r}; --scenario list prints their names')
    folder = prepare_folder(out)
    reports = []
    for name in chosen:
        try:
            reports.append(close_the_loop(
                folder / name, scenario=name, seed=seed,
                progress=progress and (lambda text, *done, name=name: progress(
                    f'{name}: {text}', *done)), **options))
        except NightFailed as err:
            reports.append({'scenario': name, 'error': str(err)})
    report = {'format': FORMAT, 'version': VERSION, 'seed': seed, 'scenarios': reports}
    incomplete = [line for one in reports for line in one.get('incomplete', ())]
    tried(incomplete, folder / 'report.json', partial(
        write_text, text=json.dumps(report, indent=1) + '\n'))
    tried(incomplete, folder / 'page.html', lambda path: write_all_page(folder, report))
    report['incomplete'] = incomplete
    report['files'] = {'report': str(folder / 'report.json'), 'page': str(folder / 'page.html')}
    return report


def _sound_run(file, place):
    """A measured run with usable columns and enough rows."""
    from calibration.analysis.diagnosis.mistaken_columns import check_columns
    from calibration.report.wording import wording

    from ..input_files.run_loader import load_run
    run = load_run(file, **place)
    check_columns(run)
    counts = reader_row_counts(run)
    if counts.too_few:
        raise ValueError(f'{file}: {wording(counts.refusal)}')
    return run


def _site_of(run, sky):
    """Site parameter of the calibration: given values, else those of the run's file.

    Without a run: the default site, which the observer of a simulated night assumes.
    """
    from pointing_model.sky.site import DEFAULT_SITE
    site = DEFAULT_SITE if run is None else run.meta.get('site') or {}
    if not isinstance(site, dict):
        site = {'latitude': site.latitude, 'longitude': site.longitude}
    site = {f'{name}_deg': value / DEG for name, value in site.items()
            if name in ('latitude', 'longitude') and value is not None} | sky
    # times from an arbitrary start do not give the stars' places
    dated = run is None or run.meta.get('time_is_utc', True)
    if not dated or not {'latitude_deg', 'longitude_deg'} <= set(site):
        return ''
    return f'{site["latitude_deg"]!r}, {site["longitude_deg"]!r}'


def _player(run, file, azimuth_origin, folder):
    """Parameters of the run player, with a file that it can read, written if necessary."""
    if is_log(file) or run.meta.get('solves_checked') or not run.mount.vertical:
        from pointing_model.runs.formats.csv import write_csv
        file, azimuth_origin = folder / 'run.csv', None
        write_csv(run, file)
    return {'file': str(file.resolve()), 'azimuth_origin': azimuth_origin or ''}


def _write(folder, about, latest):
    """Write diagnosis.json, model.json, observations.csv; `Written` with the report so far."""
    from msg_tools import topics
    from pointing_model.model import PointingModel
    from pointing_model.runs.run_messages import cloud_to_run

    diagnosis = json.loads(latest[topics.DIAGNOSIS.name].data)
    checks = latest.get(topics.CHECKS.name)
    checks = json.loads(checks.data)['checks'] if checks is not None else []
    run = cloud_to_run(latest[topics.OBSERVATIONS.name])
    report = {
        'format': FORMAT, 'version': VERSION, **about, **run.mount.entries(),
        **{key: diagnosis[key] for key in _FROM_DIAGNOSIS}, 'judged': diagnosis.get('judged'),
        'blind_before': checks[0] if checks else None,
        'blind_after': checks[-1] if len(checks) > 1 else None,
        'follows': list(diagnosis.get(FOLLOWS, {})),
        'alarms': json.loads(
            latest[topics.CALIBRATION_REPORT.name].data)['witnesses']['alarms'],
    }
    report['paired'] = paired(report)
    model = PointingModel.from_json(latest[topics.MODEL.name].data)
    report['drive'] = drive_error(run, model, diagnosis['site_deg'],
                                  bool((report['judged'] or {}).get('taken_back')))
    report['incomplete'] = write_files(folder, run, {
        'model.json': latest[topics.MODEL.name].data,
        'diagnosis.json': json.dumps(diagnosis, indent=1)})
    return Written(report, run)


def drive_error(run, model, site_deg=None, taken_back=False):
    """Tracking error of the drive at the exposures of blind stars: encoder minus demand.

    The miss of a blind star is due to model and drive errors. The residual of its row has only the
    model error, since it uses the encoder reading.

    Parameters
    ----------
    run : PointingRun
        All rows of the night.
    model : PointingModel
        The last published model.
    site_deg : tuple of float, optional
        Latitude and longitude, for effects that depend on the stars.
    taken_back : bool
        The change was taken back: the blind stars before it, not those after, match the model.

    Returns
    -------
    dict or None
        ``rms_arcsec`` (radial), ``rms_x_arcsec``, ``rms_y_arcsec``, ``stars``, and
        ``missed_arcsec``, the radial RMS miss distance of the same stars. None if there are no
        such rows, the zero tracks an encoder, or the driver of an effect is unknown there.
    """
    from pointing_model.rms import rms
    from pointing_model.runs.run import PointingRun
    from pointing_model.zero import active_zeros

    zeros = active_zeros(model)
    known = all(name in run for name in ('check', 'block', 'miss_x', 'miss_y'))
    if not known or not zeros or model.provenance.get('zero_follows'):
        return None
    blind = (run['check'] == 1.0) & np.isfinite(run['miss_x'])
    if not blind.any():
        return None
    blind &= run['block'] == (np.min if taken_back else np.max)(run['block'][blind])
    if site_deg is not None:
        site = dict(zip(('latitude', 'longitude'), np.multiply(site_deg, DEG).tolist()))
        run = PointingRun(run.columns, {**run.meta, 'site': site})
    # evaluate the whole night: effects may depend on earlier rows
    if any(rows[blind].any() for rows in model.unknown(run['az'], run['el'], run).values()):
        return None
    miss = run['miss_x'][blind], run['miss_y'][blind]
    left = model.residuals(run, zero=zeros.newest)
    x, y = ((a[blind] - b) / ARCSEC for a, b in zip(left, miss))
    return {'rms_arcsec': float(rms(x, y)), 'rms_x_arcsec': float(rms(x)),
            'rms_y_arcsec': float(rms(y)), 'stars': int(blind.sum()),
            'missed_arcsec': float(rms(*miss) / ARCSEC)}


def _add_outcome(folder, report, scenario):
    """Add the scenario, whether it was found, and the files."""
    report['undeclared'] = scenario
    comparison = report['judged'] or {}
    harmful = report['published'] and not comparison.get('taken_back') and points_worse(
        report['blind_before'], report['blind_after'], comparison)
    report['found'], report['false'] = outcome(
        scenario and scenario['shows_as'], report['effects'], report['verdict'], harmful,
        report['follows'])
    report['files'] = {name: str(folder / file) for name, file in (
        ('log', 'bag'), ('model', 'model.json'), ('observations', 'observations.csv'),
        ('report', 'report.json'), ('diagnosis', 'diagnosis.json'), ('page', 'page.html'))}
