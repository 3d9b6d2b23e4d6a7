"""Pure functions of tensors: encoding, amplifier, sampling, quadrature, bounds; imports only torch."""
