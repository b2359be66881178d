"""The validation study: cases (data) → kinds (how to measure) → store (what came out). Run: python -m validation.

A new case is a TOML file in `cases/`: scenes from `models/` or `scenes/`, a kind, the kind's settings, and per
quantity a metric, a tolerance and the reason for it. A new way to measure is a file in `kinds/`, entered in the dict
`KINDS` there.
"""
