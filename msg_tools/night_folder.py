"""What is where in the folder of a night."""

from pathlib import Path


def log_of(path):
    """The log at a path: of a night's folder its `bag`, else what was given.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    Path
    """
    path = Path(path)
    if (path / 'bag').is_dir() and not (path / 'metadata.yaml').is_file() \
            and not any(path.glob('*.mcap')):
        return path / 'bag'
    return path


def model_of(path):
    """The model at a path: of a night's folder its `model.json`, else what was given.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    Path
    """
    path = Path(path)
    return path / 'model.json' if (path / 'model.json').is_file() else path
