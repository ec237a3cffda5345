"""The best word of at most so many switches: branching over words, coarse nodes, insertions."""
