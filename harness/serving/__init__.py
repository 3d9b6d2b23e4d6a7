"""What serving a trained method costs and gains, measured on a finished run: `python -m harness serving OUT`."""
