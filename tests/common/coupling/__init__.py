"""Tests of `tis.common.coupling`."""
