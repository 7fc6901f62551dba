"""Gains: what a control period can carry, designs, and their margins."""
