"""Searches for the least cost: starts, methods, and the order in which a fit tries them."""
