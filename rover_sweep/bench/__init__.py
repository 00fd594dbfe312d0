"""Servo on blocks: the steering is moved standing still, the road wheel's angle is read, numbers come out."""
