"""Poses that programs of others send: messages, their checks, and what logs tell of them."""
