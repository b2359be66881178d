"""What every room stands on: errors, signals, and files that are written whole or not at all."""
