"""The rows of a night, taken from another table."""

import numpy as np
import pytest

from pointing_model.observing.table import NEEDED, Table
from pointing_model.run import PointingRun


def rows(*names):
    angles = ('az', 'el', 'az_enc', 'el_enc')
    return PointingRun({name: np.arange(3.0) for name in (*angles, *names)})


def test_a_night_goes_on():
    table = Table()
    table.restore(rows(*NEEDED), 2_000_000_007)
    assert len(table) == 3 and table.rows[-1]['stamp'] == 2_000_000_007


@pytest.mark.parametrize('missing', NEEDED)
def test_rows_of_nobody_are_refused(missing):
    with pytest.raises(ValueError, match=f'without column {missing}: they are of no observer'):
        Table().restore(rows(*(name for name in NEEDED if name != missing)), 1)
