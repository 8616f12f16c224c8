"""From the cells' sums to results: scores with intervals, tables, a tidy table, LaTeX, figures."""
