"""A log as a table that any program reads."""

from pathlib import Path

from msg_tools.run_files import write_csv

from .runs import load_run


def export_run(source, path, **options):
    """Write a log, or a run in another format, as CSV.

    Parameters
    ----------
    source : str or Path
        What `telescope_mount.runs.load_run` takes.
    path : str or Path
        CSV to write; `load_run` gives the same run back, and a fit the same terms to 1e-9
        arcsec.
    **options
        As for `load_run`.

    Returns
    -------
    PointingRun
        What was written; its ``meta`` says what was left out.

    Raises
    ------
    ValueError
        `source` is no run, or `path` is the same file.
    OSError
        It cannot be read, or `path` not written.
    """
    source, path = Path(source), Path(path)
    if path.exists() and path.samefile(source):
        raise ValueError(f'{path} would be written over the run it is made from')
    run = load_run(source, **options)
    write_csv(run, path)
    return run
