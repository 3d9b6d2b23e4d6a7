"""Commands for who maintains this repository, not shipped: they may import everything, and nothing imports them."""
