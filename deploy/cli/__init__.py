"""The command line `tis`: one file per group of commands, options only."""
