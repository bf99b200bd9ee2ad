"""What tests share: arms, runs, robots, engines, the command line, and where measured data is."""
