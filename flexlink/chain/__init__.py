"""Lumping: an arm as rigid segments joined by hinges, in the arrays of a `Chain`."""
