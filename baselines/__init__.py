"""The methods under comparison; imports torch and Dr.Jit, but no other room."""
