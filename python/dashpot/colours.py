"""Colours of the package's figures."""

# Okabe and Ito's palette, told apart by colour-blind readers; dashpot comes first, in blue.
COLOURS = ("#0072b2", "#d55e00", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#000000")
