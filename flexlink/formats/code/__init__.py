"""The equations of motion of a chain as source code for other programs: C, and Python for CasADi and acados."""

from flexlink.formats.code.c_text import to_c
from flexlink.formats.code.casadi_text import to_casadi

__all__ = ["to_c", "to_casadi"]
