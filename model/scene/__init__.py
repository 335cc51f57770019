"""What is asked: bodies, supports and loads."""
