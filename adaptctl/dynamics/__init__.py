"""The equations of motion, written once over scalars, and `Mechanism`, their face on arrays."""

from adaptctl.dynamics.equation_costs import EquationCosts, equation_costs
from adaptctl.dynamics.mechanism import Mechanism, load

__all__ = ["EquationCosts", "Mechanism", "equation_costs", "load"]
