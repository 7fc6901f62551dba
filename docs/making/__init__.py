"""What `make gallery` makes: the animation of the documentation's first page, and a page of all experiments."""
