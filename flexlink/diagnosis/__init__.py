"""Diagnosis: how well two engines or files agree, and which parameters differ."""
