"""Lumping: an arm becomes rigid segments joined by hinges, stored in the arrays of a `Chain`."""
