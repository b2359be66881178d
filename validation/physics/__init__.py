"""Scenes with exact, published or converged values, and the errors of any rule and number of hinges on them."""
