"""Rendered views kept for when they are asked for again (§8.1, Listing 5): in memory, and on disk as float EXR.

`store` is the levelled store with the interface of the paper's `HUAMMemory`, `keys` says what a picture depends on, and
`cached` puts both before a trained method.
"""
