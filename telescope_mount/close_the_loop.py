"""The loop closed: a night, or a measured run, is fitted, diagnosed, amended and judged."""

import json
from functools import partial

from calibration.diagnosis.rows_told import rows_of_reader
from pointing_model.observing.plan import parse_plan

from .graph import measured_graph, night_graph
from .night import NightFailed, observe, prepare_folder

FORMAT = 'telescope_mount/loop'
VERSION = 1
#: names of the scenarios that are made for it begin so
PREFIX = 'loop_'
#: what the run player does, in the words of a plan
_MEASURED_PLAN = 'fit, diagnose'


def loop_plan(stars, polaris, check):
    """The plan of a night: measure, fit, point blind, diagnose, point blind, judge by that.

    Parameters
    ----------
    stars : int
        That fit and diagnosis see.
    polaris : int
        Exposures for the zero.
    check : int
        Fresh stars before and after the diagnosis.

    Returns
    -------
    str
    """
    return (f'home, stars {stars}, polaris {polaris}, calibrate_zero, fit, check {check}, '
            f'diagnose, check {check}, judge')


def judgement(shows_as, effects):
    """Whether the diagnosis found what the scenario does.

    Parameters
    ----------
    shows_as : list of str or None
        Beginnings of names of effects.
    effects : list of dict
        Of the diagnosis, with ``name``, ``alternatives`` and ``aliases``.

    Returns
    -------
    found : {'yes', 'in the set', 'in part', 'no'} or None
        'yes': every effect is there by its first name or one that is the same curve, and nothing
        else; 'in the set': every one is among those reported together. None: not said.
    false : list of str
        Effects that are none of those.
    """
    if shows_as is None:
        return None, []

    def among(wanted, names):
        return any(name.startswith(wanted) for name in names)

    first = [[e['name'], *e['aliases']] for e in effects]
    sets = [[*names, *e['alternatives']] for names, e in zip(first, effects)]
    false = [e['name'] for e, names in zip(effects, sets)
             if not any(among(wanted, names) for wanted in shows_as)]
    if not shows_as:
        return ('no' if effects else 'yes'), false
    named = [any(among(wanted, names) for names in first) for wanted in shows_as]
    there = [any(among(wanted, names) for names in sets) for wanted in shows_as]
    if all(named):
        return 'yes', false
    if all(there):
        return 'in the set', false
    return ('in part' if any(there) else 'no'), false


def close_the_loop(out, *, scenario='', file=None, seed=1, stars=90, polaris=16, check=30,
                   check_every=4, alpha=0.01, start_time='', azimuth_origin=None, sky=None,
                   domain_number=None, progress=None):
    """Carry out one night with a scenario, or one measured run.

    Parameters
    ----------
    out : Path
        Folder for all that is written.
    scenario : str
        What is wrong with the simulated mount; or
    file : Path, optional
        a measured run, of which one row in `check_every` is kept out.
    stars, polaris, check : int
        As of `loop_plan`.
    alpha : float
        Chance that a clean night gets any effect.
    azimuth_origin : str, optional
        As of `runs.load_run`.
    seed, start_time, sky, domain_number
        As of `night.run_night`.
    progress : callable, optional
        Called with (text, done, total) as it goes on.

    Returns
    -------
    dict
        The report that ``report.json`` holds, see `FORMAT`.

    Raises
    ------
    ValueError, OSError
        Bad input.
    NightFailed
        A node ended, or a step could not be carried out.
    """
    sky = sky or {}
    if file is not None:
        # whatever cannot be read is said before a node starts
        run = _sound_run(file, azimuth_origin)
        progress = progress and partial(_of, len(run), progress)
        plan = _MEASURED_PLAN
    else:
        run, plan = None, loop_plan(stars, polaris, check)
        parse_plan(plan)
    folder = prepare_folder(out)
    calibration = {'alpha': alpha, 'site': _site_of(run, sky),
                   'diagnosis_page': str((folder / 'diagnosis.html').resolve())}
    if file is not None:
        specs = measured_graph(
            bag=str(folder / 'bag'), seed=seed, calibration=calibration,
            player=_player(run, file, azimuth_origin, folder) | {'check_every': check_every})
    else:
        specs = night_graph(
            bag=str(folder / 'bag'), scenario=scenario, seed=seed, start_time=start_time,
            plan=plan, sample_rate_hz=1.0, sky=sky, calibration=calibration)
    about = {'scenario': scenario or None, 'source': str(file) if file else None, 'seed': seed,
             'plan': plan}
    report = observe(folder, specs, plan, partial(_write, folder, about), progress, domain_number)
    if file is not None:
        report['rows_read'] += rows_of_reader(run).lost
        return _judge(folder, report, None)
    # now that everything is decided
    from .simulator import undeclared
    return _judge(folder, report, undeclared(folder / 'bag_truth'))


def close_all(out, *, seed=1, progress=None, **options):
    """`close_the_loop` with every scenario that is made for it, each in a folder of its own.

    Returns
    -------
    dict
        ``scenarios``: the report of each; one that failed has an ``error``.
    """
    from .simulator import scenario_names
    folder = prepare_folder(out)
    reports = []
    for name in scenario_names():
        if not name.startswith(PREFIX):
            continue
        try:
            reports.append(close_the_loop(
                folder / name, scenario=name, seed=seed,
                progress=progress and (lambda text, *done, name=name: progress(
                    f'{name}: {text}', *done)), **options))
        except NightFailed as err:
            reports.append({'scenario': name, 'error': str(err)})
    report = {'format': FORMAT, 'version': VERSION, 'seed': seed, 'scenarios': reports}
    (folder / 'report.json').write_text(json.dumps(report, indent=1) + '\n')
    return report


def _sound_run(file, azimuth_origin):
    """A measured run of which the columns and enough rows can be used."""
    from calibration.diagnosis import check_columns, naming_columns

    from .runs import load_run
    with naming_columns():
        run = load_run(file, azimuth_origin=azimuth_origin)
    check_columns(run)
    told = rows_of_reader(run)
    if told.too_few:
        raise ValueError(f'{file}: {told.refusal}')
    return run


def _of(total, progress, text, done, _):
    progress(text, done, total)


def _site_of(run, sky):
    """The calibration's parameter: what was given, else what the run's file says.

    Without a run, what the observer of a simulated one believes.
    """
    from msg_tools.units import DEG
    from pointing_model.sky import DEFAULT_SITE
    told = DEFAULT_SITE if run is None else run.meta.get('site') or {}
    if not isinstance(told, dict):
        told = {'latitude': told.latitude, 'longitude': told.longitude}
    told = {f'{name}_deg': value / DEG for name, value in told.items()
            if name in ('latitude', 'longitude') and value is not None} | sky
    # times from an arbitrary start say nothing of the stars' place
    dated = run is None or run.meta.get('time_is_utc', True)
    if not dated or not {'latitude_deg', 'longitude_deg'} <= set(told):
        return ''
    return f'{told["latitude_deg"]!r}, {told["longitude_deg"]!r}'


def _player(run, file, azimuth_origin, folder):
    """Parameters of the run player: a file that it can read, written if need be."""
    if file.is_dir() or file.suffix == '.mcap' or run.meta.get('of_solves'):
        from pointing_model.run_files import write_csv
        file, azimuth_origin = folder / 'run.csv', None
        write_csv(run, file)
    return {'file': str(file.resolve()), 'azimuth_origin': azimuth_origin or ''}


def _write(folder, about, latest):
    """diagnosis.json, model.json and observations.csv; the report so far."""
    from msg_tools import topics
    from pointing_model.run_files import write_csv
    from pointing_model.run_messages import cloud_to_run

    diagnosis = json.loads(latest[topics.DIAGNOSIS.name].data)
    checks = latest.get(topics.CHECKS.name)
    checks = json.loads(checks.data)['checks'] if checks is not None else []
    report = {
        'format': FORMAT, 'version': VERSION, **about,
        'verdict': diagnosis['verdict'], 'effects': diagnosis['effects'],
        'applied': diagnosis['applied'], 'published': diagnosis['published'],
        'refused': diagnosis['refused'], 'judgement': diagnosis['judgement'],
        'judged': diagnosis.get('judged'), 'noise_floor_arcsec': diagnosis['noise_floor_arcsec'],
        'before': diagnosis['before'], 'after': diagnosis['after'],
        'kept_out': diagnosis['kept_out'],
        **{key: diagnosis[key] for key in ('expected', 'rows_read', 'rows_used', 'outliers',
                                           'rms_with_outliers_arcsec')},
        'blind_before': checks[0] if checks else None,
        'blind_after': checks[-1] if len(checks) > 1 else None,
        'alarms': json.loads(
            latest[topics.CALIBRATION_REPORT.name].data)['witnesses']['alarms'],
        'notes': diagnosis['notes'],
    }
    write_csv(cloud_to_run(latest[topics.OBSERVATIONS.name]), folder / 'observations.csv')
    (folder / 'model.json').write_text(latest[topics.MODEL.name].data + '\n')
    (folder / 'diagnosis.json').write_text(json.dumps(diagnosis, indent=1) + '\n')
    return report


def _judge(folder, report, told):
    """Add what the scenario did and whether it was found, and write report.json."""
    report['undeclared'] = told
    report['found'], report['false'] = judgement(told and told['shows_as'], report['effects'])
    report['files'] = {name: str(folder / file) for name, file in (
        ('log', 'bag'), ('model', 'model.json'), ('observations', 'observations.csv'),
        ('report', 'report.json'), ('diagnosis', 'diagnosis.json'), ('page', 'diagnosis.html'))}
    (folder / 'report.json').write_text(json.dumps(report, indent=1) + '\n')
    return report
