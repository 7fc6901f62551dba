"""The null space of a tree, joint by joint from the root, in time linear in the number of links."""
