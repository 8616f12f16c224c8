"""Benchmarks of speed and punctuality, each figure beside a reference measured in the same run."""
