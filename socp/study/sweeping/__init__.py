"""One problem at many points: which data, in which order, by whose hands, and what came of it."""
