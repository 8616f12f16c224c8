"""The shell around every command: endings, run folders, child processes, optional packages."""
