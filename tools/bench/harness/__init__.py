"""What every bench shares: committed results, and the pages of docs/benchmarks made from them."""
