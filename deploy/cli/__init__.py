"""Command line `tis`: one file per group of commands, with options only."""
