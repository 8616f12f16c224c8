"""The folder of a netem that stood between two networks without a scenario: what it was asked for and what it did."""
