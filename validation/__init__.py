"""The validation study: cases (data) → kinds (how to measure) → store (what was measured). Run: python -m validation."""
