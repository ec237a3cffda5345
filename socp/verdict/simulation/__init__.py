"""A solution's control flown again where things are not as planned."""
