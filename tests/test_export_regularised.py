"""The first stage that knows the simulations in C: its program's own tests, its limits, its size.

That it gives Python's gains `test_export_plants` asks, with all other kinds.
"""

import numpy as np
import pytest
from c_programs import answers, compiled, passes
from test_export_plants import SINGULAR, faulty, trained

from tuners.compressors.regularised import Regularised
from tuners.export import compressor_source, export, first_stage_source, tuner_source
from yawrate_env.design import Status

CASE = "regularised inputs"
STAGE = Regularised(3, 5.0, (1.0, 0.5, 0.1), ((0.3, 0.0, 0.0), (0.0, 0.2, -0.1)))


@pytest.mark.parametrize("Ts", [0.001, 0.004])
def test_without_a_plant_it_takes_however_many_samples(Ts, tmp_path):
    files = compressor_source(STAGE, Ts, name="prior")
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    assert "6 samples or more, and however many" in files["prior.h"]
    assert passes(tmp_path, "prior")


def test_golden_vectors_see_a_wrong_first_stage(tmp_path):
    files = first_stage_source(trained(CASE))
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    mistakes = {"output * output": "output", "energy - explained": "energy",
                " - (double)ORDER": "", "- (weight * MEAN[k])": "+ weight", "j <= i": "j < i",
                "gram[(j * ORDER) + i] =": "gram[(i * ORDER) + j] ="}  # fmt: skip
    for right, wrong in mistakes.items():
        text = files["yawrate_laguerre.c"].replace(right, wrong)
        assert text != files["yawrate_laguerre.c"]
        (tmp_path / "yawrate_laguerre.c").write_text(text)
        parts = "yawrate_laguerre.c", "yawrate_laguerre_test.c"
        assert compiled(tmp_path, *parts, flags=["-Wno-unused"]).returncode == 1


def test_of_more_samples_than_were_trained_on_there_are_no_gains(tmp_path):
    tuner, (u, y, _) = trained(CASE), faulty(CASE)
    export(tuner, "c", tmp_path)
    for part in ("tuner", "laguerre"):
        assert "It takes 48 to 500 samples" in (tmp_path / f"yawrate_{part}.h").read_text()
    signals = np.tile(np.stack([u[7], y[7]], axis=1), (2, 1))
    counts = (47, 48, 500, 501)
    gains, status = answers(tmp_path, ([[n], signals[:n].ravel()] for n in counts))
    assert (status == Status.UNREACHABLE).tolist() == [True, False, False, True]
    for n, found in zip(counts[1:3], gains[1:3], strict=True):
        np.testing.assert_allclose(found, tuner.gains(u[7, :n], y[7:8, :n])[0], rtol=SINGULAR)
    with pytest.raises(ValueError, match="47 samples are too few"):
        tuner.gains(u[7, :47], y[7:8, :47])


def test_its_header_says_what_memory_it_takes():
    files = tuner_source(trained(CASE))
    for part in ("tuner", "laguerre"):
        assert f"a state of {8 * (25**2 + 2)} bytes" in files[f"yawrate_{part}.h"]
