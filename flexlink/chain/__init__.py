"""How an arm is cut: rigid segments joined by hinges, as the arrays of a `Chain`."""
