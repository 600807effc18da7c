"""The first stage that knows the simulations in C: its program's own tests, its limits, its size.

That it gives Python's gains `test_export_plants` asks, with all other kinds.
"""

import numpy as np
import pytest
from c_programs import answers, compiled, passes
from test_export_plants import RTOL, faulty, trained

from tuners.export import compressor_source, export, first_stage_source, tuner_source
from tuners.features.regularised import Regularised

CASE = "regularised inputs"
STAGE = Regularised(3, 5.0, (1.0, 0.5, 0.1), ((0.3, 0.0, 0.0), (0.0, 0.2, -0.1)), 1e-6)


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
    mistakes = {"+= VARIANCE": "+= 0.0", "- (weight * MEAN[k])": "+ weight", "j <= i": "j < i",
                "gram(state, j, k)": "state->gram[j][k]"}  # fmt: skip
    for right, wrong in mistakes.items():
        text = files["yawrate_laguerre.c"].replace(right, wrong)
        assert text != files["yawrate_laguerre.c"]
        (tmp_path / "yawrate_laguerre.c").write_text(text)
        parts = "yawrate_laguerre.c", "yawrate_laguerre_test.c"
        assert compiled(tmp_path, *parts, flags=["-Wno-unused"]).returncode == 1


def test_it_takes_what_python_takes(tmp_path):
    tuner, (u, y, _) = trained(CASE), faulty(CASE)
    export(tuner, "c", tmp_path)
    for part in ("tuner", "laguerre"):
        said = (tmp_path / f"yawrate_{part}.h").read_text()
        assert "It takes 48 samples or more, and however many" in said
    signals = np.tile(np.stack([u[7], y[7]], axis=1), (4, 1))
    counts = (48, 500, 2000)
    gains, _ = answers(tmp_path, ([[n], signals[:n].ravel()] for n in counts))
    for n, found in zip(counts, gains, strict=True):
        expected = tuner.gains(signals[:n, 0], signals[:n, 1][None])[0]
        np.testing.assert_allclose(found, expected, rtol=RTOL)
    with pytest.raises(ValueError, match="47 samples are too few"):
        tuner.gains(u[7, :47], y[7:8, :47])


def test_its_header_says_what_memory_it_takes():
    files = tuner_source(trained(CASE))
    for part in ("tuner", "laguerre"):
        assert f"a state of {8 * 25**2} bytes" in files[f"yawrate_{part}.h"]
