"""Stages of a pipeline: a file or folder per impairment, and the combined impairment of one key."""
