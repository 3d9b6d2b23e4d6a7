"""Stiff and extreme scenes whose rays are known in closed form; imports `modelling`."""
