"""Measures of the estimates: errors, ages, freshness."""
