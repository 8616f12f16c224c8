"""The summary as people read it: sentences and tables."""
