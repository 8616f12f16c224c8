"""The movement of a live device: its messages checked, mapped to master and arm, and sampled."""
