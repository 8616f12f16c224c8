"""From columns to the figures of the summary."""
