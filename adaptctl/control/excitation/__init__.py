"""How well a motion excites the parameters, and motions made to excite them."""
