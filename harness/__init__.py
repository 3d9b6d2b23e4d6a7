"""Who trains what on what, for how long: plan, batches, training, clock, evaluation, statistics, records."""
