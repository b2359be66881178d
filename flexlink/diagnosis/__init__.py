"""How far two engines, or two files, agree, and which parameter makes the difference."""
