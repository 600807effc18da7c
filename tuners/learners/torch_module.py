"""Second stage: any module of PyTorch that a function builds.

The file keeps the weights, and names the function: ``module:attribute``, as it does a plant's.
"""

import copy
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from tuners.learners.batches import Batches, Progress, gathered
from tuners.learners.scaling import Scaling
from tuners.learners.threads import threads
from yawrate_env.compiled import cores
from yawrate_env.plant import entry

if TYPE_CHECKING:
    import torch

Array = NDArray[np.float64]
Build = Callable[[int, int], "torch.nn.Module"]

_STATE = "state."
_MANY = 1_000_000  # numbers: fewer are trained on sooner by one thread


@dataclass(frozen=True, slots=True)
class TorchSettings:
    """A module to train by Adam on standardised features and targets, in double precision.

    Attributes
    ----------
    build : callable
        ``build(n, t)``: the module, from (m, n) features to (m, t) targets; a function of a module
        that can be imported, with random weights from PyTorch's generator.
    epochs : int
        At most.
    rate : float
        Learning rate at first; it falls to nothing along a half cosine.
    batch : int
        Rows a step.
    patience : int
        Epochs without a smaller error on the validation set after which training ends; the best
        weights are kept.
    """

    build: Build
    epochs: int = 300
    rate: float = 3e-3
    batch: int = 128
    patience: int = 50

    def fit(
        self,
        training: Batches,
        validation: Batches,
        random_state: int,
        progress: Progress | None = None,
    ) -> "TorchModule":
        """Train on batches of (m, n) features and (m, t) targets."""
        import torch

        name = entry.of(self.build, "build")
        (X, T), checked = gathered(training), gathered(validation)
        scaling = Scaling.of(X, T)
        x, t, xv, tv = (
            torch.from_numpy(a)
            for own, targets in ((X, T), checked)
            for a in (scaling.features(own), scaling.targets(targets))
        )
        with torch.random.fork_rng(devices=[]), threads(cores() if X.size >= _MANY else 1):
            torch.manual_seed(random_state)
            module = _built(self.build, x.shape[1], t.shape[1])
            self._train(module, x, t, xv, tv, progress)
        return TorchModule(name, module, scaling)

    def _train(
        self,
        module: "torch.nn.Module",
        x: "torch.Tensor",
        t: "torch.Tensor",
        xv: "torch.Tensor",
        tv: "torch.Tensor",
        progress: Progress | None,
    ) -> None:
        """Train in place, and leave the weights that are best on the validation set."""
        import torch

        steps = torch.optim.Adam(module.parameters(), lr=self.rate)
        falling = torch.optim.lr_scheduler.CosineAnnealingLR(steps, self.epochs)
        best, least, since = copy.deepcopy(module.state_dict()), np.inf, 0
        for epoch in range(self.epochs):
            module.train()
            for rows in torch.split(torch.randperm(len(x)), self.batch):
                steps.zero_grad()
                loss = torch.nn.functional.mse_loss(module(x[rows]), t[rows])
                torch.autograd.backward([loss])
                steps.step()
            falling.step()
            module.eval()
            with torch.no_grad():
                error = float(torch.nn.functional.mse_loss(module(xv), tv))
            since += 1
            if error < least:
                best, least, since = copy.deepcopy(module.state_dict()), error, 0
            ended = since > self.patience
            if progress is not None:
                progress(epoch + 1, epoch + 1 if ended else self.epochs)
            if ended:
                break
        module.load_state_dict(best)


class TorchModule:
    """A trained module.

    Parameters
    ----------
    build : str
        ``module:attribute`` of the function that builds it.
    """

    def __init__(self, build: str, module: "torch.nn.Module", scaling: Scaling) -> None:
        self.build, self.module, self.scaling = build, module.eval(), scaling

    @property
    def width(self) -> int:
        """Number of features."""
        return self.scaling.width

    def __call__(self, X: Array) -> Array:
        """Predict (B, t) targets from (B, n) features."""
        import torch

        with torch.no_grad():
            values = self.module(torch.from_numpy(self.scaling.features(X)))
        return self.scaling.from_targets(values.numpy())

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Arrays to save."""
        named = np.frombuffer(self.build.encode(), dtype=np.uint8)
        weights = {f"{_STATE}{k}": v.numpy() for k, v in self.module.state_dict().items()}
        return {"build": named, **self.scaling.arrays(), **weights}

    @classmethod
    def from_arrays(cls, arrays: dict[str, NDArray[Any]]) -> Self:
        """Rebuild from `arrays`, or ``ValueError`` where these do not go together."""
        import torch

        scaling, name = Scaling.from_arrays(arrays), arrays["build"].tobytes().decode()
        module = _built(entry.attribute(name), scaling.width, scaling.count)
        weights = {
            key.removeprefix(_STATE): torch.from_numpy(array.copy())
            for key, array in arrays.items()
            if key.startswith(_STATE)
        }
        try:
            module.load_state_dict(weights)
        except RuntimeError as error:
            why = " ".join(str(error).split())
            raise ValueError(f"{name} no longer builds the module that was saved: {why}") from None
        return cls(name, module, scaling)


def _built(build: Build, width: int, count: int) -> "torch.nn.Module":
    """The module in double precision; ``ValueError`` where `build` gives none."""
    import torch

    module = build(width, count)
    if not isinstance(module, torch.nn.Module):
        raise ValueError(f"build gives a {type(module).__name__}, not a torch.nn.Module.")
    return module.double()
