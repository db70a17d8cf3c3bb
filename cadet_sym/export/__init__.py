"""Write the compiled moment equations in forms that stand alone: a C library, a functional mock-up unit, MATLAB."""
