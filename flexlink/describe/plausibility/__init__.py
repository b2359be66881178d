"""Numbers that are likely given in another unit: what is plausible, and which unit was likely meant."""
