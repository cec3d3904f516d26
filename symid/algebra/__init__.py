"""The scalar algebras that the recursion is written over."""
