"""How near a solution on a grid is to an extremal: multipliers, and the error of its objective."""
