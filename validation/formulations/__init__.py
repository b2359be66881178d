"""The same motions by different formulations of a bending link: chains, strain modes, elements, discrete rods."""
