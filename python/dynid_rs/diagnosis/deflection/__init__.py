"""What two encoders per joint reveal of its gear."""
