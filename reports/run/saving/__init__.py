"""Outputs of a run other than its page: numbers and plots for a README, all figures in a zip, a citation."""
