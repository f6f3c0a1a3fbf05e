"""Studies: many variants of one template, planned, run by workers that may die, and resumed."""
