"""Every family of plants, and what the tests share of each."""

import pytest
from families import FAMILIES, trained
from families import tested as recordings


@pytest.fixture(scope="session", params=FAMILIES)
def family(request):
    return request.param


@pytest.fixture(scope="session")
def plant(family):
    return FAMILIES[family]


@pytest.fixture(scope="session")
def tuner(family):
    return trained(family)


@pytest.fixture(scope="session")
def episodes(family):
    """Recordings of the test set, with the truth."""
    return recordings(family)
