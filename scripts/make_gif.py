"""Draw figures/environment.gif: vehicles met one after the other, tuned step by step.

Each vehicle starts from the gains that were right for the one before it (the first from
those for the middle of the prior), and approaches the oracle's along a geometric path.

    python scripts/make_gif.py [--output figures/environment.gif] [--stills FOLDER]
"""

import argparse
from pathlib import Path

import gymnasium
import numpy as np
from PIL import Image

from yawrate_env.env.yaw_rate_env import PITuningEnv

VEHICLES = [(0.45, 280.0), (1.1, 20.0), (0.6, 180.0), (0.9, 80.0)]  # mu_s, M_delta [kg]
MIDDLE = (0.7, 150.0)
PATH = np.linspace(0, 1, 13)
WAIT, FIRST, BETWEEN, LAST = 1500, 1300, 160, 1800  # how long frames stay [ms]
COLOURS = 128


def episode(
    env: PITuningEnv, vehicle: tuple[float, float], seed: int, start: np.ndarray
) -> tuple[list[np.ndarray], np.ndarray]:
    """Frames of one vehicle, and the oracle's gains."""
    options = dict(zip(("mu_s", "M_delta"), vehicle, strict=True))
    best = oracle(env, vehicle, seed)
    frames = []
    for way in PATH:
        env.reset(seed=seed, options=options)
        if not frames:
            frames.append(env.render())
        env.step(start ** (1 - way) * best**way)
        frames.append(env.render())
    return frames, best


def oracle(env: PITuningEnv, vehicle: tuple[float, float], seed: int) -> np.ndarray:
    env.reset(seed=seed, options=dict(zip(("mu_s", "M_delta"), vehicle, strict=True)))
    info = env.step(env.action_space.low)[4]
    return np.array([info["oracle_kp"], info["oracle_Ti"]])


def save(frames: list[np.ndarray], durations: list[int], path: Path) -> None:
    """Write a GIF with one palette, undithered, so that still parts cost nothing."""
    images = [Image.fromarray(frame) for frame in frames]
    sample = Image.fromarray(np.concatenate([frames[0], *frames[1 :: len(PATH) + 1]]))
    palette = sample.quantize(COLOURS, method=Image.Quantize.MAXCOVERAGE)
    flat = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    path.parent.mkdir(parents=True, exist_ok=True)
    flat[0].save(path, save_all=True, append_images=flat[1:], duration=durations, loop=0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    default = Path(__file__).parents[1] / "figures" / "environment.gif"
    parser.add_argument("--output", type=Path, default=default)
    parser.add_argument("--stills", type=Path, help="also write every frame here, as PNG")
    args = parser.parse_args()
    env = gymnasium.make("yawrate_env:yawrate/PITuning-v0", render_mode="rgb_array").unwrapped
    gains, frames, durations = oracle(env, MIDDLE, 0), [], []
    for seed, vehicle in enumerate(VEHICLES):
        drawn, gains = episode(env, vehicle, seed, gains)
        frames += drawn
        durations += [WAIT, FIRST, *[BETWEEN] * (len(PATH) - 2), LAST]
    save(frames, durations, args.output)
    for i, frame in enumerate(frames if args.stills else []):
        args.stills.mkdir(parents=True, exist_ok=True)
        Image.fromarray(frame).save(args.stills / f"{i:02d}.png")
    print(f"{args.output}: {len(frames)} frames, {args.output.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
