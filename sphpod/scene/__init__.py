"""What is simulated: the physics of a scene, its particles and kernel, its waves and checks."""
