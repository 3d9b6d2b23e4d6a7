"""Which points of a ray are evaluated, and marching with fixed shapes; imports fields and numerics."""
