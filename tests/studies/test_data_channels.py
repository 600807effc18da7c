"""Data sets of a plant with several channels."""

import numpy as np
import pyarrow.parquet as pq
from two_by_two import N, plant

import tuners
import tuners.data
from tuners.features.laguerre import Laguerre
from tuners.learners.feedforward import FeedForwardSettings
from tuners.tuner.recording import Recording
from tuners.tuner.stages import Recipe
from yawrate_env.plant.episodes import recorded

LEARNER = FeedForwardSettings(neurons=6, epochs=40)


def test_a_data_set_has_a_column_for_each_channel_and_trains_a_tuner(tmp_path):
    features = Laguerre(3, 0.15)
    folder = tuners.data.generate(plant, "train", features, 140, 0, tmp_path / "two", raw=True)
    table = pq.read_table(folder.path / "shard-000000.parquet")
    block = recorded(plant, "train", 0, 140)
    signals = {"reflux": block.u[:, 0], "steam": block.u[:, 1]}
    signals |= {"top": block.y[:, 0], "bottom": block.y[:, 1]}
    for name, rows in signals.items():
        found = np.array(table[name].to_pylist())
        np.testing.assert_array_equal(found, np.broadcast_to(rows, (140, N)).astype(np.float32))
    assert table.schema.field("steam").metadata == {b"unit": b"kg/s"}
    assert folder.read().features.shape == (140, 2 * 2 * 3)
    tuners.data.verify(folder.path, sample=5)
    learned = tuners.data.train(folder.path, Recipe(features, LEARNER), calibration=0)
    again = tuners.train(Recipe(features, LEARNER, noise_draws=1), plant, episodes=140,
                         calibration=0)  # fmt: skip
    given = Recording(block.u, block.y, plant.Ts)
    np.testing.assert_allclose(learned.gains(given).values, again.gains(given).values, rtol=1e-4)
