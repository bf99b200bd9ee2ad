"""One module per command of `dynid`."""
