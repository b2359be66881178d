"""Find the cheapest model of a scene that meets a tolerance: the links that bend, their hinges, and the time steps."""
