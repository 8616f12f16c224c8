"""Infrastructure of all commands: exit codes, run folders, child processes, optional packages."""
