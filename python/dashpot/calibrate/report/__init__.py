"""A fit as tables, figures and progress bars."""
