"""Whether an extremal is a minimum, and what moves it: the second order of its word."""
