"""The benchmark runs, and the batch environment is worth having."""

from tuners.throughput import measure, to_markdown


def test_a_batch_beats_scalar_environments_one_after_the_other():
    result = measure(num_envs=32, rounds=3)
    contenders = result["contenders"]
    assert contenders["batch"]["ratio"]["median"] == 1
    # About 4 where nothing else runs: a ratio below 1 would mean that batching costs time.
    assert contenders["SyncVectorEnv"]["ratio"]["median"] > 1
    assert all(f["episodes_per_second"] > 0 for f in contenders.values())
    table = to_markdown(result)
    assert all(name in table for name in contenders)
