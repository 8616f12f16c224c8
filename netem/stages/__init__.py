"""Stages of a pipeline: one file per impairment, and the impairment of one key."""
