"""Conditions that vary between measurements: for each name, its column heading and the wording of a value."""

from __future__ import annotations

from collections.abc import Mapping

Fact = str | int | float
Facts = Mapping[str, Fact]
"""Name → value, in the order of printing."""

WORDS: dict[str, tuple[str, str]] = {
    "situation": ("situation", "{}"),
    "chain": ("chain", "{}"),
    "job": ("job", "{}"),
    "run": ("run", "{}"),
    "claim": ("claim", "“{}”"),
    "part": ("part", "{}"),
    "type": ("type", "{}"),
    "load": ("load", "{}"),
    "PL²/EI": ("PL²/EI [1]", "PL²/EI = {:g}"),
    "force": ("force [N]", "{:g} N"),
    "angle": ("angle [deg]", "at {:g}°"),
    "need": ("need", "{}"),
    "rule": ("lumping rule", "{}"),
    "measure": ("measure", "{}"),
    "hinges": ("hinges a link", "{} hinges"),
    "cells": ("segments", "{} segments"),
    "method": ("method", "{}"),
    "order": ("order", "order {}"),
    "arithmetic": ("arithmetic", "{}"),
    "of_limit": ("step, of the largest stable one", "step {:g} of the largest stable one"),
    "axis": ("axis", "{}"),
    "step": ("step [s]", "h = {:.4g} s"),
    "tolerance": ("tolerance [m]", "tolerance {:g} m"),
    "tip error": ("tip error [m]", "tip error {:g} m"),
    "family": ("family of rules", "{}"),
    "family of arms": ("family of arms", "{}"),
    "relative_tolerance": ("tolerance, of the reach", "tolerance {:g} of the reach"),
    "formulation": ("formulation", "{}"),
    "modes": ("modes m", "{} modes"),
    "torque": ("torque, of the full one", "torque × {:g}"),
    "relative error": ("error, of the length", "error {:g}"),
    "error": ("error, of the motion", "error {:g}"),
    "deflection error": ("error, of the deflection", "deflection error {:g}"),
    "to step": ("to step [s]", "to {:.4g} s"),
    "duration": ("duration [s]", "{:g} s"),
    "solver": ("solver for q̈", "{}"),
    "n": ("joints n", "n = {}"),
    "to n": ("to n", "to {}"),
    "form": ("form", "{}"),
    "members": ("members", "{} members"),
    "steps": ("steps", "{:,} steps"),
    "arms": ("arms", "{} arms"),
    "states": ("states", "{} random states"),
    "turns": ("turns", "{:g} turns"),
    "damping ratio": ("damping ratio [1]", "damping ratio {:g}"),
    "law": ("damping law", "{}"),
    "link": ("link", "{}"),
    "asked": ("asked for [Hz]", "asked for {:g} Hz"),
}


def column_head(name: str) -> str:
    """Head of a column, unit included."""
    return WORDS[name][0] if name in WORDS else name


def in_words(facts: Facts) -> str:
    """Describe all facts in one line, "RK4, h = 0.0001 s"."""
    return ", ".join(WORDS.get(name, ("", f"{name} {{}}"))[1].format(value) for name, value in facts.items())
