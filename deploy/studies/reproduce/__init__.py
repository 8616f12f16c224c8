"""The committed tables, computed again and compared cell by cell, `tis reproduce`."""
