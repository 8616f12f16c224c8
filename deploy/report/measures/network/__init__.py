"""Measures of the links: requested, decided and realised."""
