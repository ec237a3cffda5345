"""Signs of switching functions where their values do not tell them."""
