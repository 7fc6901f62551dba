"""Studies of designs made visible: the arm coloured by what mass costs, tables, figures, a page."""
