"""Figures for publications, drawn with matplotlib."""
