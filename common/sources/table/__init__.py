"""Recordings in tables of named columns: layout, text, poses, and the clock of the rows. Pure."""
