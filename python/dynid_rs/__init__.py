"""Torque models of robot arms from measured runs."""
