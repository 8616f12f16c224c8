"""Recordings and synthetic movements, which both surgeon and patient read."""
