"""Default recipes: features and a learner that suit a plant, in the sizes that are asked for."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from math import inf
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from tuners.features import Features, features_named
from tuners.features.laguerre import Laguerre
from tuners.features.principal import principal
from tuners.features.regularised import Regularised
from tuners.features.response import FrequencyResponse
from tuners.learners.feedforward import FeedForwardSettings
from tuners.learners.trend import TrendSettings
from tuners.trust.basis import (
    equations_of_any_input,
    functions_for,
    suited,
    suited_to_any_input,
)
from tuners.tuner.stages import Recipe
from yawrate_env import validation
from yawrate_env.plant.plant import Plant

ORDER, MORE = 8, 24
"""Laguerre functions for one input, and for an input of each episode's own."""

RESPONSE_ORDER = 12
NEURONS = 16

_SAMPLES = 10  # for each function, at least
_BAND = 0.2, 4.0  # of the crossover: frequencies whose response is a feature


MOST_NEURONS = 1000
"""Beyond these Levenberg-Marquardt's matrix, the weights squared, fills a computer's memory."""


@dataclass(frozen=True, slots=True)
class Sizes:
    """Sizes of a recipe; what is None is the usual one.

    Attributes
    ----------
    order : int, optional
        Functions of the first stage.
    pole : float, optional
        Of these functions [rad/s].
    neurons : int, optional
        Of the second stage.
    plants : int, optional
        Simulated plants that it is trained on.
    """

    order: int | None = None
    pole: float | None = None
    neurons: int | None = None
    plants: int | None = None

    def __post_init__(self) -> None:
        for name, most in (("order", inf), ("neurons", MOST_NEURONS), ("plants", inf)):
            if (given := getattr(self, name)) is not None:
                validation.count(
                    name, given, at_most=most, remedy="Leave it out for the usual one."
                )
        if self.pole is not None:
            validation.number("pole", self.pole, above=0.0, remedy="Give it in rad/s.")

    @property
    def given(self) -> tuple[str, ...]:
        """Names of those that are not None."""
        return tuple(name for name in self.__slots__ if getattr(self, name) is not None)


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A recipe that was tried.

    Attributes
    ----------
    sizes : Sizes
        All of them.
    stage : {"usual", "pilot", "grown"}
        What it was tried for: the usual recipe; a first stage, with a small learner; more of all.
    ratio : NDArray
        (f,) root mean square errors over the bound's.
    """

    sizes: Sizes
    stage: str
    ratio: NDArray[np.float64]

    @property
    def worst(self) -> float:
        """The largest ratio; none where no gains are known."""
        return float(self.ratio.max()) or np.inf

    def record(self, plant: Plant) -> dict[str, Any]:
        """The same as plain JSON values."""
        ratio = dict(zip(plant.counted, self.ratio.tolist(), strict=True))
        return asdict(self.sizes) | {"stage": self.stage, "ratio": ratio}


USUAL = Sizes()
"""None given."""

Make = Callable[[Plant, Sizes], Recipe]
"""Makes a recipe for a plant in given sizes."""


def recipe_for(plant: Plant, sizes: Sizes = USUAL) -> Recipe:
    """Features that suit the plant, a small network, fresh noise; more plants for more inputs."""
    learner = FeedForwardSettings(neurons=sizes.neurons or NEURONS, max_fail=10, epochs=300)
    features = features_for(plant, sizes.order, sizes.pole)
    return Recipe(features, learner, noise_draws=6, episodes=sizes.plants or plants_for(plant))


def plants_for(plant: Plant) -> int:
    """How many plants `recipe_for` simulates."""
    return 1000 if plant.excite is None else 2000


def most_functions(plant: Plant) -> int:
    """How many functions a recording of the experiment can tell apart."""
    return max(plant.samples // _SAMPLES // len(plant.inputs_named), 1)


def recipe_for_logs(plant: Plant, sizes: Sizes = USUAL) -> Recipe:
    """A recipe for recordings whose input and length differ from the experiment's.

    Of a linear plant with a crossover the features are its frequency response around it, which do
    not depend on the input; any other plant gets `recipe_for`.
    """
    special = plant.integrating or plant.excite is not None
    if not plant.linear or plant.crossover is None or special:
        return recipe_for(plant, sizes)
    low, high = (share * plant.crossover for share in _BAND)
    order = sizes.order or min(RESPONSE_ORDER, most_functions(plant))
    pole = sizes.pole or functions_for(plant).pole
    network = FeedForwardSettings(neurons=sizes.neurons or NEURONS, max_fail=10, epochs=120)
    return Recipe(
        FrequencyResponse(order, pole, low, high),
        TrendSettings(network),
        noise_draws=3,
        episodes=sizes.plants or 2000,
    )


def features_for(
    plant: Plant, order: int | None = None, pole: float | None = None
) -> Laguerre | Regularised:
    """Laguerre features, with a pole that suits the plant if none is given.

    A network learns what a few functions leave out of one input; where every episode has an
    input of its own it takes more functions, regularised by the prior, unless there are several.
    """
    most = most_functions(plant)
    if plant.excite is None or plant.integrating or plant.rows > 2:
        return suited(plant, order or min(ORDER, most), pole)
    return suited_to_any_input(plant, order or min(MORE, most), pole)


def confined(plant: Plant, recipe: Recipe) -> Recipe:
    """The recipe with features that know the plant's principal components, if it asks for any."""
    if not recipe.components:
        return recipe
    response = cast(FrequencyResponse, recipe.features)  # as `Recipe` has checked
    functions = Laguerre(response.order, response.pole)
    gram, right, _ = equations_of_any_input(plant, functions)
    return replace(
        recipe, features=principal(response, recipe.components, gram, right), components=0
    )


def features_by_name(plant: Plant, name: str, **settings: Any) -> Features:
    """A first stage by name; ``laguerre`` is `features_for` the plant, but for `settings`."""
    if name != "laguerre":
        return features_named(name, **settings)
    found = features_for(plant)
    if not settings:
        return found
    return features_named(name, **{"order": found.order, "pole": found.pole, **settings})


def sizes_of(recipe: Recipe) -> Sizes:
    """All sizes of a recipe that `recipe_for` or `recipe_for_logs` made."""
    features: Any = recipe.features
    network: Any = getattr(recipe.learner, "rest", recipe.learner)
    return Sizes(features.order, features.pole, network.neurons, recipe.episodes)
