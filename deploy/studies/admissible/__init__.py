"""Command `tis admissible`: the region of networks in which limits hold, its border, and profiles placed in it."""
