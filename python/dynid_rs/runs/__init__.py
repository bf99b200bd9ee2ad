"""What was measured: recordings, their readers and checks, the states made of them, training and test runs."""
