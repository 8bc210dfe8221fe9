"""A scene's mechanism as a functional mock-up unit (FMU) of FMI 2.0 and 3.0, in C."""
