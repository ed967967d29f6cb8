"""The command ``fit``."""


from . import options


def add(commands):
    """Add the parser."""
    parser = commands.add_parser(
        'fit', help='fit pointing terms to a measured run',
        description='Read a pointing run (CSV, TPOINT, or a log of ours) and print the terms and '
        'the error before and after.')
    parser.add_argument('file', type=options.log_path, metavar='RUN')
    parser.add_argument('--terms', type=options.names, help='comma-separated (default: the seven '
                        'physical terms of the mount)')
    options.add(parser, 'encoder', 'azimuth-origin', 'mount')
    options.add(parser, 'latitude', help='of the site, for runs in right ascension and of '
                'equatorial mounts')
    options.add(parser, 'longitude', 'height', 'pressure', 'temperature', 'equinox')
    parser.add_argument('--predict', action='store_true', help='add effects of the direction that '
                        'predict stars left out, without a claim that they are causes')
    parser.add_argument('--run', dest='number', type=options.whole(-10**6, 10**6), metavar='N',
                        help='of several runs in the file (column run) the one of this number')
    options.add(parser, 'harmonics', 'harmonics-alone', 'harmonics-degree')
    parser.add_argument('--no-robust', action='store_true', help='plain least squares')
    parser.add_argument('--base', type=options.model_path, metavar='MODEL',
                        help='a model file, ours or of '
                        'another program: its terms are fitted anew, its values shown beside')
    options.add_outputs(parser)


def run(args):
    """Load, fit, print, write."""
    from calibration.analysis.diagnosis import MistakenColumns
    try:
        _run(args)
    except MistakenColumns as error:
        if args.json:
            from calibration.analysis.fit_document import refused_fit
            options.write_json(args.json, refused_fit(error))
        raise


def _run(args):
    harmonics = options.harmonics_of(args)
    if args.predict and (harmonics or args.no_robust):
        raise ValueError('--predict chooses on its own, robustly: leave out '
                         + ('--harmonics' if harmonics else '--no-robust'))
    options.check_outputs(args)
    from calibration.analysis.diagnosis import check_columns, naming_columns
    from calibration.analysis.external_check import checked_by_halves
    from calibration.analysis.fit import fit_terms
    from calibration.analysis.fit_document import fit_document
    from calibration.analysis.sky_model import settled
    from calibration.report.tables import fit_tables

    from ..runs import load_run
    from .console import new_console, print_lines, write_outputs
    with naming_columns():
        observed = _one_run(load_run(args.file, azimuth_origin=args.azimuth_origin,
                                     **options.place_of(args)), args)
    if args.terms is None:
        args.terms = observed.mount.names.physical
    if f'az_{args.encoder}' not in observed:
        raise ValueError(f'{args.file} has no second encoder; leave out --encoder {args.encoder}')
    checked = check_columns(observed, args.encoder)
    base, observed = _base(args, observed)
    settled_run, origin = settled(observed, args.terms, encoder=args.encoder,
                                  robust=not args.no_robust)
    if not base:  # a model that is given says whose its errors are
        observed = settled_run
    result = fit_terms(observed, args.terms, robust=not args.no_robust, encoder=args.encoder,
                       provenance={'source': str(args.file)})
    console = new_console()
    held_out = checked_by_halves(observed, result, args.terms, args.encoder, not args.no_robust)
    for table in fit_tables(observed, result, args.encoder, held_out):
        console.print(table)
    plain = model = result.model
    document = fit_document(observed, result, args.encoder, held_out, checked)
    if harmonics:
        model, document['harmonics'] = _with_harmonics(observed, result, args, console)
    if args.predict:
        model, document['predicted'] = _to_predict(observed, args, console)
    print_lines(console, 'note', checked.warnings(observed.mount.names))
    if origin is not None:
        print_lines(console, 'sides of the pier', [origin.sentence()])
        document['origin_of_errors'] = origin.document()
    if base:
        console.print(base.table(model))
        print_lines(console, 'note', base.notes)
        document['base_model'] = base.compared(model)
    fitted = None if model is plain else model
    if base:
        model = base.whole(model)

    def write_page(path):
        from calibration.report.fit_page import write_fit_page
        write_fit_page(path, observed, result, document, args.encoder, fitted)
    write_outputs(console, (args.json, lambda p: options.write_json(p, document), 'result'),
                  (args.save, model.save, 'model'), (args.report, write_page, 'page'))


def _to_predict(observed, args, console):
    """Choose a model that predicts, print it and its error on rows left out; both."""
    from calibration.analysis.diagnosis.prediction import predictive_model
    from calibration.analysis.fit_document import predicted_document
    from calibration.report.tables import predicting_tables
    found = predictive_model(observed, '+'.join(args.terms), encoder=args.encoder)
    for table in predicting_tables(found, observed.mount):
        console.print(table)
    return found.model, predicted_document(found)


def _with_harmonics(observed, result, args, console):
    """Fit the harmonics too, print them and their cross-validation; the model, and the latter."""
    from dataclasses import replace

    from calibration.analysis.harmonic_fit import HarmonicChoice, Recipe, fit_chosen
    from calibration.report.tables import harmonic_tables
    from pointing_model.zero import NO_ZERO

    from .console import print_lines
    choice = HarmonicChoice(args.harmonics, args.harmonics_alone, args.harmonics_degree)
    recipe = Recipe(NO_ZERO, False, args.terms, args.encoder, not args.no_robust)
    fitted, section = fit_chosen(observed, choice, recipe, result)
    for table in harmonic_tables(section):
        console.print(table)
    console.print(f'{section["label"]}: {section["fitted"]["radial"]:.2f} arcsec radial on the '
                  'rows fitted')
    print_lines(console, 'note', section['notes'])
    return replace(fitted.model, provenance={
        **fitted.model.provenance, 'source': str(args.file)}), section


def _one_run(run, args):
    """The run asked for; of several that are fitted as one a note says so."""
    numbers = sorted(set(run['run'].tolist())) if 'run' in run else []
    if args.number is not None:
        rows = run.get('run') == args.number
        if not rows.any():
            there = ', '.join(f'{n:g}' for n in numbers) or 'no column run'
            raise ValueError(f'{args.file}: no run {args.number} (there: {there})')
        one = run.select(rows)
        one.meta = {**run.meta, 'lines': run.lines[rows]}
        return one
    # in logs of ours the zeros of the power-ons are known, and taken off
    if len(numbers) > 1 and not (args.file.is_dir() or args.file.suffix == '.mcap'):
        run.meta['notes'] = [*run.meta.get('notes', ()), f'{len(numbers)} runs (column run) '
                             'fitted as one, with one zero: take one with --run N, or diagnose, '
                             'which fits zeros to each']
    return run


def _base(args, run):
    """The model file that declares the terms, if one does, and the run without what it holds."""
    if args.base is None:
        return None, run
    from ..base_model import BaseModel
    if args.terms != run.mount.names.physical:
        raise ValueError('--base and --terms both say which terms to fit; leave one out')
    base = BaseModel.read(args.base, run.mount)
    args.terms = base.terms
    run = base.of_its_errors(run)
    return base, base.taken_off(run, args.encoder)
