"""Exports of a run: tables and trials."""
