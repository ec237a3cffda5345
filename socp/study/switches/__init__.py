"""Words by their number of switches: the best of each, who solves them, where they tend to."""
