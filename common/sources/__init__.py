"""Recordings and synthetic movements: surgeon and patient both read them, so they stand below both sides."""
