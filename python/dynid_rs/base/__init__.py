"""What every room may use: errors, findings, files, words, and how much samples know of each other."""
