"""A transformer that reads raw samples: what in-context identification costs on these episodes.

A recording, averaged down to 100 Hz, is cut into pieces of 0.4 s; input and output of a piece are a
token.  Encoder layers with attention (Vaswani et al., 2017) are followed by the mean over tokens,
from which two numbers are read: the controller's coordinates.  The targets are the design rule's,
the loss is their squared error in standard deviations, the simulations are those that
`studies.comparison` gives its two-stage learners.  Forgione, Pura and Piga (2023) identify whole
classes of systems in this way.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.comparison import Score, score, test
from tuners.learners.threads import threads
from tuners.tuner.recording import Recording
from yawrate_env.plant.episodes import episodes as episodes_of
from yawrate_env.plant.plant import Plant
from yawrate_env.signals.decimation import averaged
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

Array = NDArray[np.float64]
Tokens = NDArray[np.float32]
Progress = Callable[[str, int, int], None]

NAME = "transformer-raw"


@dataclass(frozen=True, slots=True)
class Settings:
    """Of the network and its training."""

    decimate: int = 10
    samples: int = 40
    layers: int = 3
    width: int = 64
    heads: int = 4
    epochs: int = 6
    batch: int = 128
    rate: float = 2e-3


@dataclass(frozen=True, slots=True, eq=False)
class Transformer:
    """A trained network that tunes recordings.

    Attributes
    ----------
    network : torch.nn.Module
        Standardised tokens to standardised coordinates.
    scale : tuple of float
        Root mean squares of input and output.
    mean, deviation : NDArray
        (m,) of the coordinates.
    """

    plant: Plant
    settings: Settings
    network: Any
    scale: tuple[float, float]
    mean: Array
    deviation: Array
    name: str = NAME

    def act(self, recording: Recording) -> Array:
        """(B, k) gains."""
        import torch

        x = torch.from_numpy(tokens(recording.u, recording.y, self.settings, self.scale))
        with torch.no_grad():
            found = np.concatenate([self.network(rows).numpy() for rows in torch.split(x, 256)])
        values = self.mean + self.deviation * found.astype(np.float64)
        return self.plant.parametrisation.decode(values)


def tokens(u: Array, y: Array, settings: Settings, scale: tuple[float, float]) -> Tokens:
    """Pieces (B, T, 2 samples) of recordings (B or 1, N), (B, N)."""
    parts = []
    for values, unit in zip((u, y), scale, strict=True):
        slow = averaged(values, settings.decimate) / unit
        T = slow.shape[1] // settings.samples
        pieces = slow[:, : T * settings.samples].reshape(len(slow), T, settings.samples)
        parts.append(np.broadcast_to(pieces, (len(y), *pieces.shape[1:])))
    return np.concatenate(parts, axis=2).astype(np.float32)


def trained(
    plant: Plant, episodes: int, seed: int, settings: Settings, progress: Progress
) -> Transformer:
    """Simulate, and fit a network to the design rule's coordinates."""
    import torch

    blocks: list[Tokens] = []
    targets: list[Array] = []
    scale = 1.0, 1.0
    for block in episodes_of(plant, "train", 0, 0, episodes):
        if not blocks:
            scale = float(np.sqrt((block.u**2).mean())), float(np.sqrt((block.y**2).mean()))
        values = plant.parametrisation.encode(plant.oracle(block.theta))
        usable = np.isfinite(values).all(axis=1)
        blocks.append(tokens(block.u, block.y, settings, scale)[usable])
        targets.append(values[usable])
    x, wanted = np.concatenate(blocks), np.concatenate(targets)
    mean, deviation = wanted.mean(axis=0), wanted.std(axis=0)
    torch.manual_seed(seed)
    network = _network(x.shape[1], x.shape[2], wanted.shape[1], settings)
    a, b = torch.from_numpy(x), torch.from_numpy((wanted - mean) / deviation).float()
    optimiser = torch.optim.AdamW(network.parameters(), settings.rate, weight_decay=1e-4)
    steps = settings.epochs * -(-len(a) // settings.batch)
    falling = torch.optim.lr_scheduler.OneCycleLR(optimiser, settings.rate, total_steps=steps)
    for epoch in range(settings.epochs):
        for rows in torch.split(torch.randperm(len(a)), settings.batch):
            loss = (network(a[rows]) - b[rows]).square().mean()
            optimiser.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
            optimiser.step()
            falling.step()
        progress(f"training {NAME}", epoch + 1, settings.epochs)
    return Transformer(plant, settings, network.eval(), scale, mean, deviation)


def scored(episodes: int, seed: int, settings: Settings, progress: Progress) -> Score:
    """One training, on the test episodes of `studies.comparison`."""
    plant = yaw_rate(Task())
    began = time.perf_counter()
    with threads(1):
        tuner = trained(plant, episodes, seed, settings, progress)
        seconds = time.perf_counter() - began
        (found,) = test({NAME: tuner}, plant)
    return score(found, episodes, seed, seconds)


def _network(T: int, inputs: int, outputs: int, settings: Settings) -> Any:
    import torch

    class Network(torch.nn.Module):
        """Encoder, mean over tokens, and a linear head."""

        def __init__(self) -> None:
            super().__init__()
            width = settings.width
            self.embed = torch.nn.Linear(inputs, width)
            self.place = torch.nn.Parameter(0.02 * torch.randn(T, width))
            layer = torch.nn.TransformerEncoderLayer(
                width, settings.heads, 2 * width, dropout=0.0, activation="gelu",
                batch_first=True, norm_first=True,
            )  # fmt: skip
            self.layers = torch.nn.TransformerEncoder(
                layer, settings.layers, enable_nested_tensor=False
            )
            self.head = torch.nn.Sequential(
                torch.nn.LayerNorm(width), torch.nn.Linear(width, outputs)
            )

        def forward(self, x: Any) -> Any:
            """Coordinates (B, m) of tokens (B, T, n)."""
            return self.head(self.layers(self.embed(x) + self.place).mean(dim=1))

    return Network()
