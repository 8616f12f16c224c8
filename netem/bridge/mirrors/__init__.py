"""Mirrors of queryables and liveliness tokens, and the queries that cross."""
