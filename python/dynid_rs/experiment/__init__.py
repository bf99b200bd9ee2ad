"""The next experiment: which motion decides most of what a diagnosis left open, and how likely it does."""
