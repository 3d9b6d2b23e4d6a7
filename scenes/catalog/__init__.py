"""The scenes of the catalogue and of users' files; imports `modelling` and the rooms below it."""
