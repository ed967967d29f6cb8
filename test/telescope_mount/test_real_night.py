"""A real mount's night: what is refused before anything is started, and which domain it is in."""

import pytest

from telescope_mount import domain


def test_a_driver_that_is_no_file_is_refused(refused, tmp_path):
    assert refused('observe', '--driver', 'absent.py', '--out', tmp_path / 'o') == (
        'error: absent.py is no file; give a driver in Python with --driver')


def test_a_plan_without_a_fit_is_refused(refused, tmp_path):
    assert 'has no fit' in refused('observe', '--plan', 'stars 3', '--out', tmp_path / 'o')


def test_the_domain_is_the_one_that_drivers_are_in(monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', '7')
    assert domain.join().number == 7 and domain.join(3).number == 3
    monkeypatch.delenv('ROS_DOMAIN_ID')
    assert domain.join().number == 0


@pytest.mark.parametrize('text', ['102', 'seven', '-1'])
def test_a_domain_that_is_none_is_refused(monkeypatch, text):
    monkeypatch.setenv('ROS_DOMAIN_ID', text)
    with pytest.raises(ValueError, match=f'domain {text}: must be 0 to 101'):
        domain.join()
