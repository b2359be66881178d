"""What the physics cases share: benchmark scenes with any rule and number of hinges, reference values, error sweeps."""
