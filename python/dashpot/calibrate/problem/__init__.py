"""What is unknown and where it goes: parameters, their setters, the systems that they make."""
