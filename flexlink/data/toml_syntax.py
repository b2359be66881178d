"""Errors of TOML syntax in words: the reason, the line of the file, and what to write instead."""

from __future__ import annotations

import re

from flexlink.common.wording import truncated


def explained(text: str, error: Exception) -> str:
    """The parser's reason, the line where it failed, and a remedy for common mistakes."""
    # patterns of the reason and of the beginning of the line, and the remedy; the first match is used
    remedies = (
        (r"Cannot declare", r"\[(.+)\]", r"merge both, or write [[\1]] in double brackets before each item of a list"),
        (r"Cannot overwrite", r"\[\[(.+)\]\]", r"write [[\1]] in double brackets each time: there is an earlier [\1]"),
        (r"Cannot", r"([\w.\"-]+)\s*=", r"\1 is given twice; delete one"),
        (r"", r".*[“”‘’„]", r"write straight quotes"),
        (r"", r".*=\s*[-+]?\d+,\d[\d.eE+-]*\s*(?:[,}\]#].*)?$", r"write a decimal point, not a comma"),
        (r"", r"[\w.\"-]+\s*=\s*[-+]?[\d.]+\s*,", r"put a list in brackets, such as [0.0, 0.0, -9.81]"),
        (r"Unclosed inline", r".*[\"\d\]]\s+\w+\s*=", r"separate keys by commas"),
        (r"", r".*=\s*[-+]?\d[\d.]*(?:[eE][-+]?\d+)?\s*(?![eE][-+]?\d)[A-Za-z°µ%]", r"write numbers without units"),
        (r"Invalid value", r".*=\s*(?:True|False)\b", r"write true and false in lower case"),
        (r"Invalid value", r"[\w.\"-]+\s*=\s*[^\W\d]", r"put text in quotes"),
        (r"", r".*(?:\{[^}]*\]|\[[^\]]*\}\s*$)", r"close { with } and [ with ]"),
        (r"Unclosed inline", r"[^}]*$", r"write the table on one line, or its keys under [TABLE]"),
        (r"Expected '='", r"\w+\s+\S", r"write KEY = VALUE"),
    )
    reason, lines = str(error), text.rstrip().splitlines()
    found = re.search(r"at line (\d+)", reason)
    line = lines[int(found[1]) - 1].strip() if found else lines[-1].strip()
    for why, begin, remedy in remedies:
        if re.match(why, reason) and (match := re.match(begin, line)):
            return f"{reason}: {truncated(line)}; {match.expand(remedy)}"
    return f"{reason}: {truncated(line)}"
