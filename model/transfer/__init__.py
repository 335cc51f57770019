"""Load transfer from cell to cell, generation by generation."""
