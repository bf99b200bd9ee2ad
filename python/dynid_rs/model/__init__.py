"""What a torque model is: its terms, how it is put together, its bodies, its files, its observer."""
