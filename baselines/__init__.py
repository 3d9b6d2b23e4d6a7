"""The methods under comparison; imports torch and Dr.Jit, no file and no other room of ours."""
