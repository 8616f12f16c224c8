"""Mirrors of queryables and liveliness tokens, and queries across the bridge."""
