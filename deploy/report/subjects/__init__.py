"""Subjects of a run's report, a file each: figures in the summary, measurement, tables."""
