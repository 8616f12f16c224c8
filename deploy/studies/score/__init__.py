"""Scores under a frozen protocol, `tis score`: data, networks and definitions that everybody shares."""
