"""Numbers of a scene from measurements: a problem as data, what the data can tell, the fit, and how well it is known.

    min over x, g, b of Σ ((g y(x) + b − measured) / σ)² + Σ ((x − prior) / deviation)²

y are columns of runs, frequencies and static deflections; x the logarithms of positive numbers, others as they are.
"""
