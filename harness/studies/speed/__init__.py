"""How fast training, rendering and scoring are on this machine; imports `studies` itself and the rooms below it."""
