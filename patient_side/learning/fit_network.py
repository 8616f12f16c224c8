"""Training of a network by Adam on drawn networks, with early stopping on people whom it has not seen.

Each path is turned at random, for the hand has no preferred direction.

First one group of examples (people, or stretches of rows) is held out, and judged after each epoch; then a network
learns from all of them for the best number of epochs.
"""

from collections.abc import Callable
from typing import Any, Final, NamedTuple, Self

import numpy as np
from scipy.special import ndtri

from tis.common.streams import Stream
from tis.patient_side.learned.inputs import Scaled, age_inputs, inputs_of
from tis.patient_side.learned.layers import Shapes
from tis.patient_side.learned.networks import Network
from tis.patient_side.learned_model import Singles, Weights
from tis.patient_side.learning.calibration import AGES, nearest_age
from tis.patient_side.learning.examples import Examples, rotations
from tis.patient_side.model_fields import Floats

# Steps of a network's training by Adam: the one place that calls JAX and Optax.
#
# The loss is the negative logarithm of a normal density, with every term weighted by a power of its own variance
# (Seitzer et al. 2022, "On the pitfalls of heteroscedastic uncertainty estimation", beta = 0.5): otherwise what is
# hard to forecast is not learned. The rate rises and then falls like a cosine, weights decay (Loshchilov and Hutter
# 2019).

_RATE: Final = 2e-3
_LAST_RATE: Final = 1e-5
_WARM_UP: Final = 0.05
_DECAY: Final = 1e-2
_LARGEST_GRADIENT: Final = 1.0
_BETA: Final = 0.5


class Batch(NamedTuple):
    """Examples as the loss reads them, each turned by a rotation of its own."""

    window: Scaled
    ages: Singles
    moves: Singles
    left: Singles

    @classmethod
    def of(cls, examples: Examples, turns: Singles) -> Self:
        """Return the batch of B examples and rotations (B, 3, 3)."""
        window = examples.window._replace(way=examples.window.way @ turns)
        return cls(window, age_inputs(examples.ages), examples.moves @ turns, examples.left @ turns)


class GradientSteps:
    """Weights under training, with Adam's moments, for ``n_steps`` steps in all."""

    def __init__(self, network: Network, first: Weights, n_steps: int) -> None:
        import jax
        import jax.numpy as jnp
        import optax

        schedule = optax.warmup_cosine_decay_schedule(
            0.0, _RATE, round(_WARM_UP * n_steps) + 1, n_steps + 2, _LAST_RATE
        )
        adam = optax.adamw(schedule, weight_decay=_DECAY)
        optimiser = optax.chain(optax.clip_by_global_norm(_LARGEST_GRADIENT), adam)

        def loss_of(weights: Any, batch: Batch) -> Any:
            inputs = inputs_of(jnp, batch.window, zero_lost=network.zero_lost)
            mean, log_deviation = network(jnp, weights, *inputs, batch.ages, batch.moves)
            variance = jnp.exp(2.0 * log_deviation)
            squares = ((batch.left - mean) ** 2).sum(axis=-1)
            density = 0.5 * squares / variance + 3.0 * log_deviation
            return (jax.lax.stop_gradient(variance) ** _BETA * density).mean()

        def step(weights: Any, moments: Any, batch: Batch) -> Any:
            gradient = jax.grad(loss_of)(weights, batch)
            change, moments = optimiser.update(gradient, moments, weights)
            return optax.apply_updates(weights, change), moments

        self._step: Any = jax.jit(step)
        self._weights: Any = {name: jnp.asarray(each) for name, each in first.items()}
        self._moments = optimiser.init(self._weights)

    def take(self, batch: Batch) -> None:
        """Take a step."""
        self._weights, self._moments = self._step(self._weights, self._moments, batch)

    @property
    def weights(self) -> dict[str, Singles]:
        """The present weights as arrays of numpy."""
        return {name: np.asarray(each, dtype=np.float32) for name, each in self._weights.items()}


BATCH: Final = 512
_FIRST_OUTPUT: Final = 0.01
_JUDGED_UP_TO: Final = 30.0
"""Age in steps: beyond a second next to nothing can be learned, and what is judged is chance."""
_AS_GOOD: Final = 1.005
_JUDGED_AT_ONCE: Final = 4096
_WATCHED: Final = 2048


class Epoch(NamedTuple):
    """The state of training after an epoch: errors over the linear forecast's.

    ``error`` is the held-out one, None where nothing is held out; ``learned`` is that on examples which are learned
    from: where it falls and the other rises, they are learned by heart.
    """

    method: str
    number: int
    n_epochs: int
    learned: float
    error: float | None


class Judged(NamedTuple):
    """Means (B, K, 3) and logarithms of deviations (B, K) for examples."""

    mean: Floats
    log_deviation: Floats

    def error_of(self, examples: Examples) -> float:
        """Return the rms error in m over that of the linear forecast: the geometric mean over ages up to 1 s."""
        nearest, weights = nearest_age(examples.ages).ravel(), examples.unit_m.ravel() ** 2
        left, linear = (
            np.bincount(nearest, weights * np.sum(error**2, axis=2).ravel(), minlength=len(AGES))
            for error in (examples.left - self.mean, examples.left)
        )
        known = (linear > 0) & (AGES <= _JUDGED_UP_TO)
        return float(np.sqrt(np.exp(np.mean(np.log(left[known] / linear[known])))))


class Trained(NamedTuple):
    """Weights after the best epoch, and the held-out error after each."""

    weights: Weights
    errors: Floats
    best: int


def train_network(
    name: str,
    network: Network,
    examples: Examples,
    held: Examples | None,
    seed: int,
    n_epochs: int,
    patience: int,
    progress: Callable[[Epoch], None],
) -> Trained:
    """Return the trained weights: after the best epoch on ``held``, else after the last one.

    The best one is the last whose error is within 0.5 % of the lowest: less is chance, and what is learned from more
    people is worth more epochs. Training ends ``patience`` epochs after the lowest error. Equal examples and seeds
    give equal weights. Oracle in test_fit_network: circles, which the linear forecast does not know.
    """
    n_steps = max(1, len(examples) // BATCH)
    steps = GradientSteps(network, first_weights(network.shapes, seed), n_steps * n_epochs)
    order, turns = Stream.named(seed, f"learning/{name}/order"), Stream.named(seed, f"learning/{name}/turns")
    watched = some_of(examples)
    errors: list[float] = []
    after: list[Weights] = []
    for epoch in range(n_epochs):
        chosen = np.argsort(order.uniforms(epoch * len(examples), len(examples)), kind="stable")
        for k in range(n_steps):
            rows = chosen[k * BATCH : (k + 1) * BATCH]
            drawn = turns.uniforms(3 * (epoch * len(examples) + k * BATCH), 3 * len(rows)).reshape(-1, 3)
            steps.take(Batch.of(examples.rows(rows), rotations(drawn)))
        weights, error = steps.weights, None
        if held is not None:
            after.append(weights)
            error = judge(network, weights, held).error_of(held)
            errors.append(error)
        learned = judge(network, weights, watched).error_of(watched)
        progress(Epoch(name, epoch + 1, n_epochs, learned, error))
        if errors and epoch >= int(np.argmin(errors)) + patience:
            break
    if held is None:
        return Trained(steps.weights, np.empty(0), n_epochs)
    best = int(np.flatnonzero(np.array(errors) <= _AS_GOOD * min(errors))[-1])
    return Trained(after[best], np.array(errors), best + 1)


def judge(network: Network, weights: Weights, examples: Examples) -> Judged:
    """Return the network's answers to examples, in numpy as in a run."""
    means, deviations = [], []
    for begin in range(0, len(examples), _JUDGED_AT_ONCE):
        some = examples.rows(np.arange(begin, min(begin + _JUDGED_AT_ONCE, len(examples))))
        inputs = inputs_of(np, some.window, zero_lost=network.zero_lost)
        mean, log_deviation = network(np, weights, *inputs, age_inputs(some.ages), some.moves)
        means.append(mean.astype(float))
        deviations.append(log_deviation.astype(float))
    return Judged(np.concatenate(means), np.concatenate(deviations))


def some_of(examples: Examples) -> Examples:
    """Return examples from all over the given ones, at most `_WATCHED`: their error is told after each epoch."""
    return examples.rows(np.arange(0, len(examples), -(-len(examples) // _WATCHED)))


def first_weights(shapes: Shapes, seed: int) -> dict[str, Singles]:
    """Return the first weights: normal, of variance 1 / inputs (LeCun et al. 1998), and small in the last layer."""
    found = {}
    for name, shape in shapes.items():
        if name.endswith(".bias"):
            found[name] = np.zeros(shape, dtype=np.float32)
            continue
        size = int(np.prod(shape))
        drawn = ndtri(Stream.named(seed, f"learning/weights/{name}").uniforms(0, size)).reshape(shape)
        scale = _FIRST_OUTPUT if name == "head.last.weight" else 1.0
        found[name] = (scale * drawn / np.sqrt(shape[0])).astype(np.float32)
    return found
