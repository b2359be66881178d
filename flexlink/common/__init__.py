"""Basics that every package uses: errors, signals, and files that are written completely or not at all."""
