"""What a rigid arm with Coulomb and viscous friction lacks, put into the simulated one on request."""
