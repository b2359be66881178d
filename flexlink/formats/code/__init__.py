"""The equations of motion of a chain as source code for other programs: C, Python for CasADi and acados, FMUs."""

from flexlink.formats.code.c_text import to_c
from flexlink.formats.code.casadi_text import to_casadi
from flexlink.formats.code.fmu import to_fmu

__all__ = ["to_c", "to_casadi", "to_fmu"]
