"""Random draws in blocks, addressed by sequence number or run time."""
