"""The rows of a night that a calibration takes, one after the other or as a table."""

from msg_tools.status import Taken
from pointing_model.row_retention import first_of_last

from .analysis.sky_model import with_errors
from .row_store import RowStore
from .rows import check_mount, with_marks


class NightRows:
    """Rows of one mount, in the order in which they came.

    Parameters
    ----------
    reference : PointingModel, optional
        Of an earlier night, of the same mount.
    power_ons : int
        So many have their rows kept, the last ones; 0: all.

    Attributes
    ----------
    last_stamp : int
        Of the newest row, ns; 0 before the first.
    """

    def __init__(self, reference=None, power_ons=0):
        self.reference, self.power_ons = reference, power_ons
        self._rows, self.last_stamp = RowStore(power_ons), 0
        #: whose the errors of the mount are, as the last fit found or an earlier model has it
        self._errors = None if reference is None else reference.mount.errors

    def __len__(self):
        return len(self._rows)

    @property
    def taken(self):
        """How many rows are here, and how many were, `msg_tools.status.Taken`."""
        return Taken(len(self), self.power_ons, self._rows.forgotten, self.last_stamp)

    @property
    def newest(self):
        """Number of the newest power-on; ValueError before the first row."""
        return int(self.observations()['run'].max())

    def add(self, run, stamp):
        """Take rows of the night; rows that are not newer than those here are known already.

        Parameters
        ----------
        run : PointingRun
            With columns `star` and `run`.
        stamp : int
            Of the newest row, ns.

        Raises
        ------
        ValueError
            A column is missing, or the rows are of another mount.
        """
        self._check(run)
        if stamp > self.last_stamp:
            before = self._rows.forgotten
            self._rows.add(with_marks(run), stamp)
            self.last_stamp = stamp
            if self._rows.forgotten > before:
                self._forget(self._rows.forgotten - before)

    def _check(self, run):
        for name in ('star', 'run'):
            if name not in run:
                raise ValueError(f'observation without column {name}')
        check_mount(run.mount, {
            'the observations before': self._rows.mount,
            'the reference model': self.reference and self.reference.mount})

    def _forget(self, rows):
        """So many rows, the first ones, are gone: their power-ons are not kept any more."""

    def take_table(self, run, stamp):
        """Take the table of all rows so far, if there is more in it than here.

        Parameters
        ----------
        run : PointingRun
            All rows of the night, or of its last power-ons: what is here of earlier ones stays.
        stamp : int
            Of the newest row, ns.

        Returns
        -------
        int
            How many rows were not here.

        Raises
        ------
        ValueError
            As of `add`.
        """
        self._check(run)
        table = run.select(slice(first_of_last(run['run'], self.power_ons), None))
        count, new = self._rows.lacks(table)
        if stamp < self.last_stamp or count <= 0:
            return 0
        if new is None:
            self._rows.drop(table['run'])
            new = table
        self.last_stamp = 0
        self.add(new, stamp)
        return count

    def observations(self, until=0):
        """All rows so far (with `until`, those that had come by that stamp), a PointingRun.

        Raises
        ------
        ValueError
            There is none.
        """
        if not len(self):
            raise ValueError('no observation has come yet; observe first')
        run = self._rows.all(until)
        return with_errors(run, self._errors) if self._errors else run
