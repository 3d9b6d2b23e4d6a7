"""What a setting changes: learning rates, the repair, accelerations, what is left out."""
