"""Forms of a rule in other languages: a C++ header, signal temporal logic; the monitor `stl`."""
