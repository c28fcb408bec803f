"""Co-simulators that move vehicles; each proposes, none decides."""
