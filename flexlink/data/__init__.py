"""Tables and documents from files: read strictly, with units, before anything is known of arms."""
