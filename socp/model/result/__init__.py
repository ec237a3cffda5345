"""A solution in four parts: its point, what it cost, what is judged of it, where it is from."""
