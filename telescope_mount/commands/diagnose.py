"""The command ``diagnose``: what is wrong with a mount."""

import argparse
from itertools import groupby
from pathlib import Path

from .. import interrupt
from . import options
from .console import ProgressLine, new_console, print_lines, write_outputs

BASES = ('physical, standard6, index, sh13 (or sh1 to sh4; sh4p: E as printed), or terms, '
         'joined by +')


def add(commands):
    """Add the parser."""
    parser = commands.add_parser(
        'diagnose', help='find what a pointing model lacks, on logs and measured runs',
        description='Fit the declared model to pointing runs, look at what it leaves, name the '
        'physical effect that explains it, and prove the gain on data that neither the fit nor '
        'the choice has seen.')
    parser.add_argument('runs', nargs='+', type=options.log_path, metavar='RUN',
                        help='pointing runs of one mount: logs, CSV, TPOINT, MMT or IRAM files')
    parser.add_argument('--base', default='physical', metavar='MODEL',
                        help=f'what the model has already: {BASES} (default: physical); or a '
                        'model file, ours or of another program, whose terms are fitted anew')
    parser.add_argument('--own', type=options.names, metavar='TERMS', help='terms that each run '
                        'or session fits for itself (default: of several, IA,IE and what pays)')
    parser.add_argument('--sessions', type=_hours, metavar='HOURS',
                        help='a gap longer than this begins a session, with terms of its own; '
                        'none: take runs as they are (default: gaps of hours, if the rows say so)')
    parser.add_argument('--graduation', metavar='NAME=LINES', help='lines or bars in a turn of '
                        'the encoders, such as grating=47200 or az.grating=47200,el.bars=1080: '
                        'outliers by whole ones are slips (default: what a log of ours tells)')
    parser.add_argument('--cause', action='append', default=[], metavar='COLUMN', help='a column '
                        'of the file that may be a cause, though its name does not say so')
    parser.add_argument('--horizon', type=options.horizon, default=(), metavar='CORNERS',
                        help="the site's skyline, as azimuth and elevation of its corners: "
                        '0 12, 45 20.5, 180 8; or a file with one on each line: nothing behind it '
                        'is proposed')
    options.add(parser, 'alpha')
    parser.add_argument('--holdout', nargs='+', type=options.log_path, default=[], metavar='RUN',
                        help='judge on these as well; only the terms of --own (or IA,IE) are '
                        'refitted there, as on a new night')
    options.add_outputs(parser, save='the model with what was found')
    options.add(parser, 'encoder', 'azimuth-origin')
    options.add(parser, 'latitude', help='of the site, for runs in right ascension and of '
                'equatorial mounts')
    options.add(parser, 'longitude', 'height', 'pressure', 'temperature', 'mount',
                'equinox')
    options.add(parser, 'seed', default=0, help='of the resampling (default: 0)')
    options.add(parser, 'jobs')


def run(args):
    """Load, diagnose, print, write."""
    from calibration.analysis.diagnosis import MistakenColumns, naming_columns
    try:
        with naming_columns():
            return _run(args)
    except MistakenColumns as error:
        if args.json:
            from calibration.report.diagnosis_document import refused_document
            options.write_json(args.json, refused_document(error))
        raise


def _run(args):
    from calibration.analysis.diagnosis import check_columns, diagnose
    from calibration.report.wording import wording
    from msg_tools.forks import cores

    from ..runs import load_runs
    console = new_console()
    place = options.place_of(args) | {'graduation': args.graduation, 'drivers': args.cause}
    runs, empty = load_runs(args.runs, **place)
    held, empty_held = load_runs(args.holdout, runs, **place) if args.holdout else (None, [])
    print_lines(console, 'note', [*empty, *empty_held])
    for one in runs:
        if args.horizon:
            one.meta['skyline'] = args.horizon
    check_columns([*runs, *(held or ())], args.encoder)  # before minutes of work
    base = _base_file(args.base, runs[0].mount)
    if base:
        runs, held = ([base.taken_off(base.of_its_errors(run), args.encoder) for run in each]
                      if each else each for each in (runs, held))
    else:
        runs, held = _settled(runs, held, args, console)
    with ProgressLine(unit='folds', first='looking for effects', lines=True) as progress:
        def on(*what):
            interrupt.check()
            progress(*what)
        found = diagnose(runs, '+'.join(base.terms) if base else args.base, args.alpha,
                         holdout=held, own_terms=args.own, encoder=args.encoder, seed=args.seed,
                         sessions=args.sessions, progress=on, jobs=args.jobs or cores(),
                         first_answer=lambda first: console.print(wording(first), markup=False))
    found.whole = not (base and base.held is not None)
    show(found, console)
    if base:
        from calibration.report.tables import base_table
        console.print(base_table(base, found.model))
        print_lines(console, 'note', map(wording, base.notes))
    _write(args, found, console, base)
    return 2 if found.verdict == 'refused' else 0


def _settled(runs, held, args, console):
    """The runs, with the errors that hold by the longest of them; said where they do not turn."""
    from calibration.analysis.sky_model import settled_together
    (runs, held), origin = settled_together(runs, held, encoder=args.encoder)
    if origin is not None:
        from calibration.report.fit_wording import origin_sentence
        print_lines(console, 'sides of the pier', [origin_sentence(origin)])
    return runs, held


def _base_file(text, mount):
    """The model file that declares the base, if ``--base`` names one."""
    if '/' not in text and not Path(text).suffix:
        from calibration.analysis.diagnosis.diagnosis_base import Base
        try:
            Base.parse(text, mount=mount)
            return None
        except ValueError:
            if not Path(text).is_file():
                raise
    from calibration.analysis.base_model import BaseModel
    return BaseModel.read(text, mount)


def _write(args, found, console, base=None):
    from calibration.report.diagnosis_document import diagnosis_document
    document = diagnosis_document(found) | (
        {'base_model': base.compared(found.model)} if base else {})
    model = base.whole(found.model) if base else found.model

    def write_page(path):
        from calibration.report.diagnosis_page import write_report
        write_report(found, path, args.runs)
    write_outputs(console, args, document, model=model.save, page=write_page)


def _hours(text):
    """Hours of a gap; none: 0."""
    try:
        return 0.0 if text == 'none' else float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f'{text!r}: write a number of hours, or none') from None


def show(found, console):
    """The verdict in words, the error before and after, the effects, what was left out."""
    from calibration.analysis.diagnosis.row_counts import row_word
    from calibration.report.diagnosis_document import diagnosis_document
    from calibration.report.diagnosis_words import floor_words, verdict_sentences
    from calibration.report.effect_words import effect_summaries, effect_title
    from calibration.report.method_words import (
        choice_sentence,
        no_star_sentences,
        serves_sentence,
        signs_sentences,
    )
    from calibration.report.row_wording import expected_sentence, left_out_lines, used_sentence
    from calibration.report.tables import new_table
    from calibration.report.wording import paragraph, wording
    from pointing_model.effects.base import driver_word
    document, names = diagnosis_document(found), found.observations.run.mount.names
    first, second = names.columns
    headline, sentences = verdict_sentences(document, effect_summaries(found), limit=20,
                                            caution=paragraph(found.cautions))
    console.print(used_sentence(document), markup=False)
    console.print(headline, style='bold', markup=False)
    for sentence in sentences:
        console.print(f'  {sentence}', markup=False)
    console.print()
    errors = new_table(f'RMS on the sky, arcsec, {document["observations"]} observations',
                       'judged on', f'before: {first}', second, 'radial', f'after: {first}', second,
                       'radial')
    before, after = document['before'], document['after']
    errors.add_row('the rows fitted', *(_number(part[key]) for part in (before, after)
                                        for key in ('rms_x_arcsec', 'rms_y_arcsec', 'rms_arcsec')))
    stretches = found.cv_contiguous
    for label, *values in (
            ('rows left out (the choice repeated)', *(
                part[f'cv_rms_{axis}arcsec'] for part in (before, after)
                for axis in ('x_', 'y_', ''))),
            ('stretches of time left out', *(
                stretches.get(f'{when}{axis}') for when in ('before', 'after')
                for axis in ('_x', '_y', ''))),
            ('runs held out', None, None, before['holdout_rms_arcsec'], None, None,
             after['holdout_rms_arcsec'])):
        if values[2] is not None:
            errors.add_row(label, *('' if v is None else _number(v) for v in values))
    console.print(errors)
    spread = after['cv_spread']
    if spread and spread['partitions'] > 1:
        console.print(f'mean of {spread["partitions"]} ways to leave rows out; after goes from '
                      f'{_number(spread["min_arcsec"])} to {_number(spread["max_arcsec"])} arcsec')
    if choice_sentence(document):
        console.print(choice_sentence(document), markup=False)
    if found.expected:
        console.print(expected_sentence(document))
    console.print(f'{floor_words(document)}: {_number(document["noise_floor_arcsec"])} arcsec '
                  'radial (what is left, corrected for the number of coefficients)\n')
    if found.effects:
        effects = new_table('Effects, in the order of the RMS on the sky that they take off',
                            'effect', 'on', 'driver', 'p', 'ΔBIC', 'takes off, arcsec',
                            'gain, arcsec')
        for one, effect in zip(found.effects, document['effects']):
            acts = {'az': first, 'el': second}.get(effect['axes'], effect['axes'])
            effects.add_row(effect_title(one, names.axes), acts,
                            driver_word(effect['driver']).replace('_', ' '),
                            _number(effect['p_family'], 4), _number(effect['delta_bic'], 1),
                            _number(effect['removes_rms_arcsec']),
                            _number(effect['cv_gain_arcsec']))
        console.print(effects)
    for line in left_out_lines(found.excluded, len(found.observations.runs) > 1,
                               row_word(found.observations.run)):
        console.print(line, markup=False)
    print_lines(console, 'note', dict.fromkeys(map(wording, found.notes)))
    print_lines(console, 'note', signs_sentences(
        found.columns_alike, names, found.observations.run.meta.get('format')))
    largest = document['effects'][0]['name'] if document['effects'] else None
    for line in filter(None, [*_proposals(document), serves_sentence(document),
                              *no_star_sentences(document, largest)]):
        console.print(line, markup=False)


def _proposals(document, most=6):
    """A line for each pair of causes: the places that tell them apart, one after the other."""
    from calibration.report.method_words import causes_of, enough, place_words, proposals
    from pointing_model.effects.base import readable
    from pointing_model.mount_kinds import USUAL
    told, kind = causes_of(document), document.get('mount') or USUAL
    for separates, group in groupby(proposals(document)[:most],
                                    key=lambda item: item['separates']):
        group = list(group)
        names = ' from '.join(told.get(name) or readable(name) for name in separates)
        yield (f'next, to tell {names} ({enough(group)}): observe '
               + '; '.join(place_words(item, kind) for item in group))


def _number(value, digits=2):
    return '-' if value is None else f'{value:.{digits}f}'

