"""Basic functions that every package uses: errors, signals, and safe writing of files."""
