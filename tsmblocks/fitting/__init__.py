"""Fits: free parameters of a diagram found from recordings, with how well the recordings determine them."""
