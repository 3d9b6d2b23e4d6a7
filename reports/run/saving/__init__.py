"""What a run gives besides its page: numbers and plots for a README, all figures in a zip, how to cite it."""
