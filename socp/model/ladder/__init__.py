"""The ladder of what can be said of a solution beyond first order: its rungs as frozen records."""
