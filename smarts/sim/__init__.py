"""The step: who owns which vehicle, and in what order things happen."""
