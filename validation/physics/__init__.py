"""Scenes with exact, published or converged values, and the errors of chains of any rule and number of hinges."""
