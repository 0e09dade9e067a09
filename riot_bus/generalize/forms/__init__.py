"""Forms of a rule that others carry out: a function on single values, Python, C++, a formula."""
