"""The cheapest model of a scene that meets a tolerance: which links bend, how, and with which steps."""
