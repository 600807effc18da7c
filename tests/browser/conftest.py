"""One browser for each module."""

import pytest
from browsing import launched

browser = pytest.fixture(scope="module")(launched)
