"""Recordings: what is shown of a solution and how it is laid out, as plain records."""
