import numpy as np
import pytest

from msg_tools.units import ARCSEC
from pointing_model.drivers import InForce
from pointing_model.model import PointingModel
from pointing_model.zero import NO_ZERO, RunZero

AZ, EL = np.array([0.5, 3.0]), np.array([0.6, 1.1])


def test_nothing_is_in_force_at_first():
    now = InForce()
    assert now.model is None and now.zero is NO_ZERO and now.models == now.zero_stamp == 0
    np.testing.assert_array_equal(now.encoder(AZ, EL), np.column_stack([AZ, EL]))


def test_model_and_zero_act_once_each():
    model = PointingModel({'IA': 120 * ARCSEC, 'CA': 50 * ARCSEC, 'TF': -30 * ARCSEC})
    zero = RunZero(33.0 * ARCSEC, -21.0 * ARCSEC)
    now = InForce(model)
    now.take_zero(7, zero)
    wanted = np.column_stack(model.sky_to_encoder(AZ, EL)) + zero.angles
    np.testing.assert_array_equal(now.encoder(AZ, EL), wanted)
    assert now.zero_stamp == 7


@pytest.mark.parametrize('stamp, known', [(12, 12), (None, 0), ('12', 0)])
def test_a_model_is_counted_and_dated(stamp, known):
    now = InForce()
    now.take_model(PointingModel({'IA': 0.0}, provenance={'last_stamp_ns': stamp}).to_json())
    assert (now.models, now.model_stamp) == (1, known)


def test_a_text_that_is_no_model_changes_nothing():
    now = InForce(PointingModel({'IE': 1.0}))
    with pytest.raises(ValueError):
        now.take_model('no JSON')
    assert now.model.terms == {'IE': 1.0} and now.models == 0


def test_a_model_and_the_zero_that_it_tells_of():
    def told(zeros):
        now = InForce(PointingModel({}, provenance={'zeros_in_force': zeros}))
        now.take_zero(1, RunZero(20.0 * ARCSEC, -9.0 * ARCSEC))
        return now.zero_is_of_model()
    first = {'run': 1, 'az_arcsec': 1.0, 'el_arcsec': 2.0}
    newest = {'run': 2, 'az_arcsec': 20.0, 'el_arcsec': -9.0}
    assert told([first, newest]) and not told([first])
    assert told([]) and told(None)
    assert not told([first, newest | {'el_arcsec': -9.001}])
    with pytest.raises(ValueError, match='not a zero'):
        told([{'run': 2}])
