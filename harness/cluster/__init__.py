"""The same plan on a Ray cluster: which nodes there are, what travels to them, and what comes back."""
