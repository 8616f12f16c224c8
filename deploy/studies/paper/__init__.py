"""Command `tis paper`: the paper's tables, recomputed, beside the printed ones."""
