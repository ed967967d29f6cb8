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

"""The page of a night: one file with all its results."""

import json
from datetime import datetime, timezone
from pathlib import Path

import numpy as np

from calibration.analysis.external_check import split_half
from calibration.distrust import distrusted
from calibration.report.row_wording import expected_sentence
from calibration.report.track_page import innovations_figure, tracking_lines
from calibration.rows import is_kept_out
from msg_tools.bag.bag_pair import parameters_of
from msg_tools.bag.sqlite import open_bag
from msg_tools.bag.topic_names import prefix_of
from msg_tools.units import ARCSEC
from pointing_model.model import PointingModel
from pointing_model.runs.run import PointingRun
from pointing_model.runs.run_messages import cloud_to_run
from pointing_model.zero import NO_ZERO, Zeros, active_zeros, is_for_zero
from pointing_model.zero_drift import Following

from . import page_parts as page
from .error_ranking import ErrorLine, errors_section, term_lines
from .health_section import health_section
from .log_health import log_health
from .night_document import BOTH, RAW, steps_of
from .page_html import body_of, whole
from .provenance import provenance_section, site_text
from .residual_figures import controls, residual_sections, sky_maps
from .residuals import run_residuals
from .terms_section import terms_section
from .zero_figures import zeros_of, zeros_section

#: suffixes of the topics used for a page: single rows, all rows, and results
_ENDS = ('observation', 'observations', 'calibration/report', 'model', 'tracking',
         'observer/checks')
#: files in the folder of a night that the page names, if they exist
FILES = ('observations.csv', 'model.json', 'report.json', 'diagnosis.json')
_OLD_RAW = 'as the encoders read'  # in older logs


def night_page(run, model, report, log):
    """The page of a night as text, including the page of a diagnosis in the folder of the log.

    Parameters
    ----------
    run : PointingRun
        All rows.
    model : PointingModel
        The model published last.
    report : dict
        Report of the calibration, with ``tracking`` and ``checks`` if any.
    log : Path
        Log of the night, in one folder with the files that the page names.

    Returns
    -------
    str
    """
    diagnosed = log.parent / 'diagnosis.html'
    return render_night(
        run, model, report, log_summary(log),
        diagnosed.read_text(encoding='utf-8') if diagnosed.is_file() else '',
        [log, *(log.parent / name for name in FILES if log.is_dir())])


def page_of_log(log):
    """The page of a past night as text, from its log alone.

    Parameters
    ----------
    log : Path
        Folder or file.

    Returns
    -------
    str

    Raises
    ------
    ValueError
        It is no log of a night, or the log of the simulator's truth.
    OSError
        It cannot be read.
    """
    log = Path(log)
    bag = open_bag(log)
    rows, last = [], {}
    prefix = prefix_of(bag)
    for message in bag.messages([f'{prefix}{end}' for end in _ENDS], decode=True):
        end = message.topic.removeprefix(prefix)
        if end == 'observation':
            rows.append(cloud_to_run(message.data))
        else:
            last[end] = message.data
    if not rows and 'observations' not in last:
        raise ValueError(f'{log} has no observation in it; it is no log of a night')
    run = cloud_to_run(last['observations']) if 'observations' in last else None
    if run is None or len(run) < sum(map(len, rows)):
        run = PointingRun.concatenate(rows)  # it was interrupted
    report, tracking, checks = (json.loads(last[end].data) if end in last else {} for end in (
        'calibration/report', 'tracking', 'observer/checks'))
    report = report or {'notes': []}
    if tracking:
        report['tracking'] = tracking
    report['checks'] = checks.get('checks', [])
    model = PointingModel.from_json(last['model'].data) if 'model' in last \
        else PointingModel({}, mount=run.mount)
    return night_page(run, model, report, log)


def log_summary(log):
    """Health and parameters of a log, for `render_night`; unreadable parts are missing."""
    try:
        bag = open_bag(log)
        return {'health': log_health(log), 'site': parameters_of(bag.metadata, '/star_observer'),
                'split_seed': (parameters_of(bag.metadata, '/calibration') or {}).get('split_seed'),
                'written_with': ', '.join(bag.metadata.get('telescope_mount', {}).values())}
    except (OSError, ValueError) as error:
        return {'health': None, 'problem': str(error)}


def render_night(run, model, report, log=None, diagnosis='', files=()):
    """The page of a night as text.

    Parameters
    ----------
    run, model, report
        See `night_page`.
    log : dict, optional
        Result of `log_summary`.
    diagnosis : str
        Page of the diagnosis of the night, to include.
    files : iterable of Path
        Input files.

    Returns
    -------
    str
    """
    log = log or {}
    data = residuals_of(run, model, report, log.get('split_seed'))
    names = run.mount.names.axes
    when = '' if data.time is None else \
        f'{datetime.fromtimestamp(float(np.nanmin(data.time)), timezone.utc):%Y-%m-%d}'
    rows = zeros_of(report, run, (log.get('health') or {}).get('marks', ()))
    params = log.get('site') or {}
    begin, end = _span(data.time)
    body = [
        page.heading(f'Night{" of " * bool(when)}{when}'), _meta(run, begin, end),
        controls(data), _verdict(report, data),
        _largest(report, run, files),
        terms_section(report.get('terms'), report.get('correlations'), note='Encoder − catalogue, '
                      'σ from the fit. IA[2]: how far IA of power-on 2 is from that of the first.'),
        page.folded_section('RMS', page.bar_chart(_headline(report)[1], *_noise(report))),
        *residual_sections(data),
        zeros_section(report, rows, names), health_section(log.get('health'), run, names),
        _models(report), _tracking(report.get('tracking')),
        _diagnosis(diagnosis),
        page.folded_section('Notes', page.sentence_list(report.get('notes') or ())),
        provenance_section([
            ('observed', f'{begin} to {end} UTC' if begin else ''),
            ('site', site_text(params)), ('mount', report.get('mount') or run.mount.kind),
            ('plan', params.get('plan')), ('written with', log.get('written_with')),
            ('seed of the stars held out', log.get('split_seed')),
            ('log', log.get('problem'))], files),
        page.FOOTER]
    return whole(f'Night {when}'.strip(), body, 'A night of a telescope mount')


def _span(time):
    if time is None:
        return '', ''
    return tuple(f'{datetime.fromtimestamp(float(edge(time)), timezone.utc):%Y-%m-%d %H:%M}'
                 for edge in (np.nanmin, np.nanmax))


def _meta(run, begin, end):
    runs = len(np.unique(run['run'])) if 'run' in run and len(run) else 0
    text = f'{len(run)} observations'
    if runs:
        text += f' in {runs} power-on{"s" * (runs > 1)}'
    if begin:
        text += f' · {begin} to {end} UTC'
    return page.paragraph(f'{text}, mount {run.mount.kind}', 'meta')


def _headline(report):
    """Errors before and after: headline, bars and large numbers.

    Parameters
    ----------
    report : dict
        Report of `CalibrationState.fit`.

    Returns
    -------
    headline : str or None
        None if nothing was fitted.
    bars : list
        See `page_parts.bar_chart`.
    numbers : list of (float, str)
    """
    first, zeroed, last = steps_of(report)
    if last is None:
        return None, [], []
    shown = [step for step in (first, zeroed, last) if step]
    sizes = [f'{step["held_out"]["radial"]:.2f}″' for step in shown]
    start = RAW if _step_name(first) == RAW else 'with the ' + first['step']
    middle = f', {sizes[1]} with the zero set' if zeroed else ''
    headline = f'{sizes[-1]} RMS on held-out stars with the model; {sizes[0]} {start}{middle}'
    words = ['before: ', *[''] * bool(zeroed), 'after: ']
    numbers = [(size, f'{word}{_step_name(step)}') for size, word, step in zip(sizes, words, shown)]
    bars = [(_step_name(step), [(step['held_out']['radial'], 'after' if step is last else 'before',
                             'stars held out')]) for step in shown]
    return headline, bars, numbers


def _step_name(step):
    return RAW if step['step'] == _OLD_RAW else step['step']


def _verdict(report, data):
    headline, _, numbers = _headline(report)
    alarms = (report.get('witnesses') or {}).get('alarms', [])
    lines = [f'Alarm: {text}' for text in alarms]
    if report.get('expected'):
        text = expected_sentence(report)
        lines.append(text[:1].upper() + text[1:] + '.')
    lines += [f'{check["stars"]} fresh stars pointed at blind: {check["rms_arcsec"]:.2f}″ radial '
              f'RMS, {check["lost"]} lost.' for check in report.get('checks', ())
              if check['stars']]
    if report.get('verdict'):
        lines.append('The night was diagnosed after the fit, see below: '
                     f'{report["verdict"].replace("_", " ")}. The figures of the residuals are of '
                     'the model that was published last.')
    left = int((~data.used).sum())
    if left:
        lines.append(f'{left} of {len(data)} stars are not used: their table says why.')
    if headline is None:
        size = data.radial('after')
        headline = 'Nothing was fitted' if size is None else \
            f'Nothing was fitted; {size:.2f}″ RMS, {data.after_text}'
    alarm = 'alarm' if alarms else ''
    return page.verdict_section(headline, [
        page.cards(numbers), page.paragraph('RMS on the sky.', 'note'), sky_maps(data),
        page.sentence_list(lines)], alarm, alarm)


def _largest(report, run, files):
    """Zero and terms as ranked errors, and where to look for the remaining error."""
    first, zeroed, last = steps_of(report)
    # a zero set on Polaris absorbs all other terms there: the rest is in both index terms
    terms = [row for row in report.get('terms') or ()
             if not (zeroed and row['name'] in run.mount.names.index)]
    lines = term_lines(terms, run.select(~is_for_zero(run)) if 'star' in run else run)
    if zeroed:
        before, after = (step['held_out']['radial'] for step in (first, zeroed))
        lines.append(ErrorLine(
            'Zero of the power-on', None, float(np.sqrt(max(before**2 - after**2, 0.0))),
            ['incremental encoders count from where they were switched on'],
            'set the zero on Polaris after each power-on'))
        lines.sort(key=lambda one: -one.removes_arcsec)
    left = '' if last is None else f' What causes the {last["held_out"]["radial"]:.2f}″ left: ' + (
        'see Diagnosis.' if report.get('verdict') else
        f'telescope-mount diagnose {Path(*Path(files[0]).parts[-2:]) if files else "LOG"}')
    return errors_section(lines, note=f'Zero and model correct these.{left}')


def _noise(report):
    noise = report.get('noise_arcsec')
    return (float(np.hypot(*noise)), 'noise of the fit') if noise else (None, '')


def _tracking(document):
    if not document:
        return None
    return page.folded_section('Adaptive model', [
        page.sentence_list(tracking_lines(document)),
        innovations_figure(document['innovations'].get('squares') or ())],
        'After the fit each star updated the model. The residuals above are of the last one.')


def _diagnosis(text):
    return page.folded_section('Diagnosis', body_of(text) or page.paragraph([
        'Not diagnosed. ', page.code('telescope-mount diagnose bag --report diagnosis.html'),
        ' looks for what the model lacks.']))


# ------------------------------------------------------------------------------------------- rows

def residuals_of(run, model, report, split_seed=None):
    """Residuals of a night: with the zero alone, and with the model.

    Parameters
    ----------
    run, model, report
        See `night_page`.
    split_seed : int, optional
        Random seed that selected the held-out stars of the check; None: unknown.

    Returns
    -------
    Residuals
        Exposures for a zero are excluded.
    """
    stars = ~is_for_zero(run) if 'star' in run else np.ones(len(run), bool)
    rows = Following.from_model(model).corrected(run).select(stars) if len(run) else run
    measured = Zeros.from_list(report.get('zeros') or [])
    active = active_zeros(model) or Zeros.from_list(report.get('zeros_in_force') or [])
    plain = PointingModel({}, mount=rows.mount)
    before, after = (_offsets(one, rows, zeros) for one, zeros in (
        (plain, measured), (model, active)))
    used, words = _words(run, report, split_seed)
    noise = report.get('noise_arcsec')
    return run_residuals(
        rows, [_name(star) for star in rows.get('star', np.arange(len(rows)))], before, after,
        used[stars], words[stars], group_word='power-on', noise=tuple(noise) if noise else None,
        before_text='all stars, zero set, no model' if measured else 'raw',
        after_text='all stars, zero and model' if model.terms or model.harmonics else 'raw')


def _offsets(model, rows, zeros):
    if not len(rows):
        return np.zeros((2, 0))
    zero = NO_ZERO
    if zeros:
        zero = zeros.filled(np.unique(rows['run']), NO_ZERO) if 'run' in rows else zeros.newest
    return np.array(model.residuals(rows, zero=zero)) / ARCSEC


def _name(star):
    if isinstance(star, (float, np.floating)):
        return f'HIP {star:.0f}' if star > 0 else f'satellite {-star:.0f}' if star < 0 else '0'
    return str(star)


def _words(run, report, split_seed):
    """Which rows the fit used, and the fate of each row in words."""
    n = len(run)
    words = np.full(n, 'used' if report.get('terms') else 'not fitted', dtype=object)
    if not n:
        return np.zeros(0, bool), words
    satellite, lied = run.get('star', np.zeros(n)) < 0, distrusted(run)
    kept_out = is_kept_out(run)
    words[satellite] = 'satellite: for checks only'
    words[kept_out] = 'fresh star, pointed at blind: for validation, not fitted'
    words[lied] = 'excluded: the camera was frozen, mirrored or turned'
    used = ~(satellite | kept_out | lied)
    fitted = used.copy()
    if report.get('last_stamp_ns') and 'time' in run:
        # times are floats in seconds since 1970, precise to microseconds
        fitted &= run['time'] <= report['last_stamp_ns'] * 1e-9 + 1e-3
        words[used & ~fitted] = 'came after the fit'
    stars = np.flatnonzero(fitted & ~is_for_zero(run))
    if split_seed is not None and len(stars) > 1 and report.get('steps'):
        half = split_half(run.select(stars), split_seed)
        words[stars[~half]] = 'used; held out in the check'
    for one in report.get('outliers') or ():
        at = (run['star'] == one['star']) & (one['time'] is None or (
            np.abs(run.get('time', np.full(n, one['time'])) - (one['time'] or 0.0)) < 1e-3))
        far = float(np.hypot(one['x_arcsec'], one['y_arcsec']))
        for i in np.flatnonzero(at & used):
            words[i] = words[i].replace('used', f'rejected: an outlier, {far:.1f}″ off')
        used &= ~at
    return used, words


def _models(report):
    """Table of all models: RMS on the stars fitted and on held-out stars."""
    _, _, last = steps_of(report)
    rows = [(_step_name(step) + ' ← published' * (step is last and step['step'] != BOTH),
             *_rms(step['used']), *_rms(step['held_out']), step['held_out']['n'])
            for step in report.get('steps') or ()]
    out = page.table(('correction', 'fitted: first axis ″', 'second ″', 'radial ″',
                      'held out: first axis ″', 'second ″', 'radial ″', 'stars held out'), rows,
                     'numbers', 'Models compared')
    checks = [(check['check'], *_rms(check), check['n'])
              for check in report.get('external_check') or ()]
    checked = page.subsection('External check', page.table(
        ('model and stars', 'first axis ″', 'second ″', 'radial ″', 'stars'), checks,
        'numbers', 'External check'))
    return page.folded_section('Models compared', [out, checked], 'Half of the stars fit each '
                               'model, the other half validates it. RMS on the sky, arcsec.')


def _rms(values):
    return [page.number(values[key]) for key in ('x', 'y', 'radial')]
