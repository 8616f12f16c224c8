"""Identification of the simulated arm's dynamics: masses, inertias and friction from movements and torques."""
