"""Pointing runs from files: our CSV, TPOINT, the raw nights of the MMT, logs of the IRAM 30 m."""

from .checks import NoUsableRow
from .csv import iso_utc, write_csv
from .run_reader import read_run, swap_encoders
from .run_table import NoObservations

__all__ = ['NoObservations', 'NoUsableRow', 'iso_utc', 'read_run', 'swap_encoders', 'write_csv']
