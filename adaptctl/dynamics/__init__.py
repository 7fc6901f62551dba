"""Equations of motion over scalars (`Equations`) and on arrays (`Mechanism`)."""

from adaptctl.dynamics.equation_costs import EquationCosts, equation_costs
from adaptctl.dynamics.equations import Equations
from adaptctl.dynamics.loading import load
from adaptctl.dynamics.mechanism import Mechanism
from adaptctl.dynamics.motion import Motion

__all__ = ["EquationCosts", "Equations", "Mechanism", "Motion", "equation_costs", "load"]
