"""The validation study: cases (data) → kinds (how to measure) → store (what came out). Run: python -m validation."""
