"""Parameter identification: fit scene parameters to measurements, with an identifiability check and 95 % intervals.

    min over x, g, b of Σ ((g y(x) + b − measured) / σ)² + Σ ((x − prior) / deviation)²

y are the predicted columns of runs, natural frequencies and static deflections, with gains g and biases b of their
instruments and noise σ. x are the logarithms of positive parameters and the plain values of all others.
"""
