"""Simulations: their clients, topics, motions and recordings."""
