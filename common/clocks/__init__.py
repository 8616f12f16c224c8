"""What two clocks have to do with each other: exchanges of stamps, and a model fitted to them. Pure."""
