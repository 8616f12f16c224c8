"""Studies on top of comparisons: the paper computed again, methods and definitions beside it, admissible networks."""
