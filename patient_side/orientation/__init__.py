"""Estimators of the arm's orientation and of its gripper's angle, beside those of its position."""
