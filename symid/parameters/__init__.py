"""What can be known of a robot: base parameters, their values, consistent standard parameters."""
