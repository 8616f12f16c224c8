"""Mouse and gamepad as operators' devices: a window, and the poses on the surgeon's network."""
