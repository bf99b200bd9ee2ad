"""Tracing a residual to the physical effect that the model lacks: look, add, fit everything again, look again."""
