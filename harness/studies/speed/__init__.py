"""How fast training, rendering and scoring are on this machine."""
