"""The benchmark runs, and the batch environment is worth having."""

from benchmarks.throughput import measure


def test_a_batch_beats_scalar_environments_one_after_the_other():
    found = measure(num_envs=32, rounds=3)
    first, *_ = found
    assert first == "batch environment, 32" and found[first]["ratio"]["median"] == 1
    # About 4 where nothing else runs: a ratio below 1 would mean that batching costs time.
    assert found["SyncVectorEnv"]["ratio"]["median"] > 1
    assert found["plain loop over reset and step"]["ratio"]["median"] > 1
    assert all(f["milliseconds"]["least"] > 0 for f in found.values())
