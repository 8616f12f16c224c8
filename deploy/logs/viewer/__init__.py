"""Messages for viewers in the merged file: poses, metrics, log lines."""
