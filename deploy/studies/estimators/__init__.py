"""Page on the estimators, `tis compare --page`: a repeatable comparison, and the purpose of each."""
