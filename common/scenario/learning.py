"""Training of the learned methods."""

from pydantic import Field

from tis.common.scenario.base import Part


class Learning(Part):
    """Training of learned methods (gpr, srlsmf, srlsmf_l1, transformer, informer, cnn)."""

    seed: int = Field(
        1,
        strict=True,
        ge=0,
        lt=1 << 31,
        description="Seed of all that training draws: networks, first weights, order of the examples. It also "
        "selects whom training is judged on.",
    )
    passes: int = Field(
        2, strict=True, ge=1, le=20, description="Number of drawn networks through which each trial is seen."
    )
    epochs: int = Field(
        16, strict=True, ge=1, le=1000, description="Maximum number of epochs of a network's training."
    )
    patience: int = Field(
        8,
        strict=True,
        ge=1,
        le=1000,
        description="Number of epochs without a better held-out error after which training ends.",
    )
