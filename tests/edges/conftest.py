"""Fixtures of the tests of logs."""

import pytest
from log_files import CASES


@pytest.fixture(params=CASES)
def case(request):
    return CASES[request.param]


@pytest.fixture
def path(tmp_path):
    return tmp_path / "log.csv"
