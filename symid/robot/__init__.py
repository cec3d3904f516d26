"""What the robot is: numbers and names, no symbols."""
