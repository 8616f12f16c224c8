"""The part that runs on each host: `tis host`, which obeys the requests of `tis up` and `tis collect`."""
