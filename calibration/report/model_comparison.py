"""Which models were compared, and what is said of the best in one sentence."""

from calibration.analysis.held_out import BOTH, RAW, steps_of

from .page_parts import number, section, table


def headline_of(report):
    """Before and after in one sentence, its bars and its large numbers.

    Parameters
    ----------
    report : dict
        Of `CalibrationState.fit`.

    Returns
    -------
    headline : str or None
        None where nothing was fitted.
    bars : list
        As of `parts.gains`.
    numbers : list of (float, str)
    """
    first, zeroed, last = steps_of(report)
    if last is None:
        return None, [], []
    before = f'{first["held_out"]["radial"]:.2f}″'
    start = 'as the encoders read' if first['step'] == RAW else 'with the ' + first['step']
    after = f'{last["held_out"]["radial"]:.2f}″'
    middle = f', {zeroed["held_out"]["radial"]:.2f}″ with the zero set,' if zeroed else ''
    headline = f'Stars held out: from {before} {start}{middle} to {after} with the model'
    numbers = [(before, f'before: {first["step"]}')]
    if zeroed:
        numbers.append((f'{zeroed["held_out"]["radial"]:.2f}″', zeroed['step']))
    numbers.append((after, f'after: {last["step"]}'))
    if report.get('noise_arcsec'):
        x, y = report['noise_arcsec']
        numbers.append((f'{x:.2f}″, {y:.2f}″', 'noise of the fit, each axis'))
    shown = [step for step in (first, zeroed, last) if step]
    bars = [(step['step'], [(step['held_out']['radial'], 'after' if step is last else 'before',
                             'stars held out')]) for step in shown]
    return headline, bars, numbers


def models_section(report):
    """Every kind of model on the stars that it was fitted to, and on others."""
    _, _, last = steps_of(report)
    rows = []
    for step in report.get('steps') or ():
        name = step['step'] + (' ← published' if step is last and step['step'] != BOTH else '')
        rows.append((name, *(number(step[half][key]) for half in ('used', 'held_out')
                             for key in ('x', 'y', 'radial')), step['held_out']['n']))
    out = table(('correction', 'fitted: first axis ″', 'second ″', 'radial ″',
                 'held out: first axis ″', 'second ″', 'radial ″', 'stars held out'), rows,
                'numbers', 'Models compared') if rows else ''
    checks = [(check['check'], *(number(check[key]) for key in ('x', 'y', 'radial')), check['n'])
              for check in report.get('external_check') or ()]
    if checks:
        out += '<h3>External check</h3>' + table(
            ('model and stars', 'first axis ″', 'second ″', 'radial ″', 'stars'), checks,
            'numbers', 'External check')
    return section('Models that were compared', out, note='Half of the stars fit each model, the '
                   'other half judges it. RMS on the sky, arcsec.')
