"""Records for viewers in the merged log: poses, metrics, log lines."""
