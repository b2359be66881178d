"""Tables and documents from files, read strictly and with units; independent of arms."""
