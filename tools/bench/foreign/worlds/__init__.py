"""Simulators that are not of our making: their tasks, scripted experts, and the true role of every body."""
