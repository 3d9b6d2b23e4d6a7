"""Cases in which the truth of every ray is known: quadrature, encodings, cameras, an independent reference."""
