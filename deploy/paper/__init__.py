"""`tis paper`: the tables of the paper, computed again, beside what the paper prints."""
