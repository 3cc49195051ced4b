"""Residuals of a problem and their derivatives, by parallel simulation."""
