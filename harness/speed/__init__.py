"""How fast this machine trains, renders and scores, as ratios inside one run: one file a question."""
