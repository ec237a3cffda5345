"""What motions conserve, and which end conditions depend on others by it."""
