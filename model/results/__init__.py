"""What every answer is stored in, and how it is read again."""
