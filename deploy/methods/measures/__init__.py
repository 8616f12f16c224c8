"""Measures of the methods: twins under chosen networks and trainings, times of steps, and what follows from both."""
