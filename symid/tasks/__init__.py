"""Tasks that take several rooms: identify, validate, compare, export, check, as functions of products."""
