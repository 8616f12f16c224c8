"""The rules by which a model's order is chosen; without pydantic, as identification is also a library."""

from typing import Literal

OrderRule = Literal["auto", "energy", "gap", "criterion", "validation"]

Order = int | OrderRule
"""A number of states (arx: lags), or the rule that chooses it."""
