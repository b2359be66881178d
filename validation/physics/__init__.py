"""Scenes with exact, published or converged values, and their errors for any rule and number of hinges."""
