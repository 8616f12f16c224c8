"""Steps of a network's training by Adam: the one place that calls JAX and Optax.

The loss is the negative logarithm of a normal density, with every term weighted by a power of its own variance
(Seitzer et al. 2022, "On the pitfalls of heteroscedastic uncertainty estimation", beta = 0.5): otherwise what is hard
to forecast is not learned. The rate rises and then falls like a cosine, weights decay (Loshchilov and Hutter 2019).
"""

from typing import Any, Final, NamedTuple, Self

import numpy as np

from patient_side.learned.inputs import Scaled, age_inputs, inputs_of
from patient_side.learned.networks import Network
from patient_side.learned_model import Singles, Weights
from patient_side.learning.examples import Examples

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
