"""Pointing runs from files: our CSV, TPOINT, the raw nights of the MMT, logs of the IRAM 30 m."""

from .files import COLUMNS, NoObservations, iso_utc, read_run, swap_encoders, write_csv

__all__ = ['COLUMNS', 'NoObservations', 'iso_utc', 'read_run', 'swap_encoders', 'write_csv']
