"""Random draws in blocks, addressed by sequence number or by run time."""
