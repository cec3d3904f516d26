"""What a joint does besides moving its link: friction."""
