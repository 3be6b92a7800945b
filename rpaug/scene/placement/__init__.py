"""Where an instance may stand: free space on the support, and what standing there touches."""
