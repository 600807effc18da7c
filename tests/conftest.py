import itertools

import pytest
from gymnasium.utils import seeding
from hypothesis import settings

# The same examples in every run, and no deadline: the first call of a kernel compiles it.
settings.register_profile("tests", derandomize=True, deadline=None)
settings.load_profile("tests")


@pytest.fixture(autouse=True)
def _the_same_episodes_in_every_run(monkeypatch):
    """Environments that a test leaves unseeded draw other episodes each, but always the same."""
    drawn, seeded = itertools.count(), seeding.np_random
    monkeypatch.setattr(
        seeding, "np_random", lambda seed=None: seeded(next(drawn) if seed is None else seed)
    )
