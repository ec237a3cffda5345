"""A report as a page: its formulas, its plots, the page itself."""
