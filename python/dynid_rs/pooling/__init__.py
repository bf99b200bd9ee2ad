"""Arms of one type together: what they share, how each of them deviates, which are odd and why."""
