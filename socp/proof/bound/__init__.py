"""Lower bounds: what finds a subsolution, and what checks its certificate."""
