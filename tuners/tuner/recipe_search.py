"""Search for a recipe whose learner is near the bound, where the usual one is not.

The usual recipe is the cheapest candidate.  It stays where its learner is within `ENOUGH` times the
bound, and where the step on the fitted plant gets there, since a better learner would not change
the answer.  Else first stages of other orders, and then of other poles, are tried with a small
learner on a part of the same recordings, and the best of them gets more neurons and more plants
until the learner is near the bound or gains little.  All candidates are measured on plants that
none of them learned from.  Sizes that are given are kept.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from tuners import features as first_stages
from tuners.features import Features
from tuners.learners.feedforward import FeedForwardSettings
from tuners.tuner.against_bound import ENOUGH, Comparison, Errors, least_errors
from tuners.tuner.examples import examples
from tuners.tuner.recipes import NEURONS, Candidate, Make, Sizes, most_functions, sizes_of
from tuners.tuner.recording import Recording
from tuners.tuner.remedy import remedy
from tuners.tuner.stages import Recipe, Stages, coordinates_of, train_stages
from tuners.tuner.training import expected, fit
from tuners.tuner.tuner import Tuner
from yawrate_env.plant.episodes import Episodes, episodes
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

MOST_SIMULATIONS = 8000
"""Of a slow plant, in the whole training: more plants than that allows are not tried."""

ORDERS = 2 / 3, 3 / 2, 2.0
"""Times the usual order."""

POLES = 0.6, 1.6
"""Times the pole that suits the order."""

GROWTH = (1.5, 2), (2.0, 4)
"""Times the usual neurons and plants, one after the other."""

HELD_OUT = 2**40
"""Number of the first episode of the ``train`` set that only compares recipes."""

_PILOT, _HELD, _DRAWS = 512, 256, 2  # plants to learn from and to measure, recordings of each
_EPOCHS = 60
_GAINED = 0.9  # times the error: sizes that gain less are the last
_BETTER = 0.98  # times the error: what is no better stays cheap


@dataclass(frozen=True, slots=True)
class Search:
    """What is searched, from a trained and judged tuner of the usual recipe on.

    Attributes
    ----------
    make : callable
        Makes recipes of any `Sizes`.
    given : Sizes
        Sizes that are not searched.
    recipe : Recipe
        The usual one, in these sizes.
    seed, calibration : int
        Of the training, and its episodes that calibrate.
    alone : bool
        Whether the learner must be near the bound where the fitted plant is, too.
    progress : callable, optional
        As of `tuners.tuner.training.fit`.
    """

    make: Make
    given: Sizes
    recipe: Recipe
    seed: int
    calibration: int
    alone: bool = False
    progress: Progress | None = None

    def __call__(self, tuner: Tuner, found: Comparison) -> tuple[Tuner, Comparison]:
        """The same tuner, or one of a better recipe, and how it is judged.

        Its record keeps as ``search`` the candidates and their errors over the bound.
        """
        errors = found.own if self.alone else found.answer
        usual = Candidate(sizes_of(self.recipe), "usual", found.own.ratio())
        if errors.ratio().max() <= ENOUGH:
            return self._kept(tuner, [usual], usual), found
        held = _Validation.of(tuner.plant, self.seed)
        assert isinstance(tuner.method, Stages)
        usual = replace(usual, ratio=held.ratio(tuner.method))
        if errors is found.own and usual.worst <= ENOUGH:  # by chance it was a little above
            return self._kept(tuner, [usual], usual), found
        first, pilot = self._first_stage(tuner.plant, held)
        best, grown, other = usual, [usual], None
        for candidate, trained in self._grown(tuner, held, first, usual):
            grown.append(candidate)
            if candidate.worst < _BETTER * best.worst:
                best, other = candidate, trained
        if other is not None:
            tuner = Tuner(tuner.plant, other[0], _without_gains(tuner) | other[1])
            found = found.with_learner(tuner, self.seed)
        self._kept(tuner, [usual, *pilot, *grown[1:]], best)
        if found.answer.ratio().max() > ENOUGH:
            tuner.training["search"]["remedy"] = remedy(tuner.plant, found.answer, grown)
        return tuner, found

    def _kept(self, tuner: Tuner, tried: Sequence[Candidate], best: Candidate) -> Tuner:
        """The tuner, whose record holds the candidates."""
        rows = [each.record(tuner.plant) | {"chosen": each is best} for each in tried]
        tuner.training["search"] = {"given": list(self.given.given), "tried": rows}
        return tuner

    def _grown(
        self, tuner: Tuner, held: "_Validation", first: Sizes, usual: Candidate
    ) -> Iterator[tuple[Candidate, tuple[Stages, dict[str, Any]]]]:
        """Larger recipes, trained, until one is near the bound or gains little."""
        before, name = usual, tuner.training["name"]
        for neurons, plants in GROWTH:
            recipe = self._larger(tuner.plant, first, neurons, plants)
            if sizes_of(recipe) == before.sizes:
                return
            trained = fit(tuner.plant, recipe, seed=self.seed, name=name, progress=self.progress)
            candidate = Candidate(sizes_of(recipe), "grown", held.ratio(trained[0]))
            yield candidate, trained
            if candidate.worst <= ENOUGH or candidate.worst > _GAINED * before.worst:
                return
            before = candidate

    def _first_stage(self, plant: Plant, held: "_Validation") -> tuple[Sizes, list[Candidate]]:
        """Sizes of the best first stage in a pilot, and the pilot's candidates."""
        own, most = sizes_of(self.recipe), most_functions(plant)
        order = own.order or 1
        orders = {min(max(round(share * order), 2), most) for share in ORDERS} - {order}
        free = "order" not in self.given.given
        candidates = [self.given, *(replace(self.given, order=n) for n in sorted(orders) if free)]
        tried = self._piloted(plant, held, candidates)
        best = min(tried, key=_worst)
        if "pole" not in self.given.given and best.sizes.pole is not None:
            poles = [share * best.sizes.pole for share in POLES]
            others = [replace(self.given, order=best.sizes.order, pole=pole) for pole in poles]
            tried += self._piloted(plant, held, others)
            best = min(tried, key=_worst)
        if best.worst > _BETTER * tried[0].worst:
            return self.given, tried
        return replace(self.given, order=best.sizes.order, pole=best.sizes.pole), tried

    def _piloted(
        self, plant: Plant, held: "_Validation", candidates: Sequence[Sizes]
    ) -> list[Candidate]:
        """First stages that a small learner was trained on, with the same recordings."""
        network = FeedForwardSettings(neurons=NEURONS, epochs=_EPOCHS)
        count = min(_PILOT, self.recipe.episodes)
        small = replace(self.given, neurons=NEURONS, plants=count)
        recipes = [
            replace(
                self.make(plant, replace(small, order=each.order, pole=each.pole)),
                learner=network, noise_draws=_DRAWS,
            )
            for each in candidates
        ]  # fmt: skip
        several = _Several(tuple(recipe.features for recipe in recipes))
        data = examples(plant, count, self.seed, several, noise_draws=_DRAWS)
        widths = several.widths(plant)
        targets = data.targets(coordinates_of(plant, self.recipe.parametrisation))
        tried = []
        for i, recipe in enumerate(recipes):
            begin = sum(widths[:i])
            own = data.features[:, begin : begin + widths[i]]
            own = np.concatenate([own, data.features[:, sum(widths) :]], axis=1)
            trained, _ = train_stages(recipe, data.number, own, targets, data.usable, self.seed)
            sizes = replace(sizes_of(recipe), plants=count)
            tried.append(Candidate(sizes, "pilot", held.ratio(trained)))
            if self.progress is not None:
                self.progress("searching", i + 1, len(recipes))
        return tried

    def _larger(self, plant: Plant, first: Sizes, neurons: float, plants: int) -> Recipe:
        """A larger recipe with a first stage; more plants with fewer recordings of each."""
        own, fixed = sizes_of(self.recipe), self.given.given
        more = self.recipe.episodes * (1 if "plants" in fixed else plants)
        if plant.slow and expected(plant, more, self.calibration) + _HELD > MOST_SIMULATIONS:
            more = self.recipe.episodes
        sizes = replace(first, plants=more)
        if "neurons" not in fixed:
            sizes = replace(sizes, neurons=round(neurons * (own.neurons or NEURONS)))
        draws = max(self.recipe.noise_draws * self.recipe.episodes // more, _DRAWS)
        return replace(self.make(plant, sizes), noise_draws=draws)


@dataclass(frozen=True, slots=True)
class _Several:
    """First stages side by side, which see the same recordings."""

    stages: tuple[Features, ...]

    any_experiment: ClassVar[bool] = False

    @property
    def width(self) -> int:
        return sum(stage.width for stage in self.stages)

    def widths(self, plant: Plant) -> list[int]:
        """How many features each gives of a plant's recordings."""
        y = plant.respond(np.repeat(plant.middle, 2, axis=0))
        return [first_stages.rehearse(stage, plant.u[None], y, plant.Ts) for stage in self.stages]

    def __call__(self, u: Array, y: Array, Ts: float) -> tuple[Array, NDArray[np.bool_]]:
        found = [stage(u, y, Ts) for stage in self.stages]
        usable = np.all([each for _, each in found], axis=0)
        return np.concatenate([values for values, _ in found], axis=1), np.asarray(usable)


@dataclass(frozen=True, slots=True, eq=False)
class _Validation:
    """Recordings that compare recipes, `_DRAWS` of each plant, and the bound."""

    plant: Plant
    blocks: tuple[tuple[Episodes, ...], ...]
    bound: Array

    @classmethod
    def of(cls, plant: Plant, seed: int) -> Self:
        blocks = tuple(
            tuple(episodes(plant, "train", seed, HELD_OUT, _HELD, draw)) for draw in range(_DRAWS)
        )
        return cls(plant, blocks, np.concatenate([least_errors(plant, b) for b in blocks[0]]))

    def ratio(self, stages: Stages) -> Array:
        """Root mean squares (f,) of the errors of trained stages, over the bound's."""
        plant, errors = self.plant, []
        theta = np.concatenate([block.theta for block in self.blocks[0]])
        right = plant.metric_values(theta, plant.oracle(theta))
        for draw in self.blocks:
            given = (Recording(b.u, b.y, plant.Ts, b.theta) for b in draw)
            gains = np.concatenate([stages.gains(plant, each).values for each in given])
            errors.append(plant.metric_values(theta, gains) - right)
        return Errors(theta, np.array(errors), self.bound).ratio()


def _worst(candidate: Candidate) -> float:
    return candidate.worst


def _without_gains(tuner: Tuner) -> dict[str, Any]:
    return {"without_gains": tuner.training["without_gains"]}
