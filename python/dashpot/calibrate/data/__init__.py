"""Trajectories as they were recorded: frames, channels, time, noise."""
