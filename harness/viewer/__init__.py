"""A local page in which one orbits a trained scene, methods side by side: `python -m harness view OUT`."""
