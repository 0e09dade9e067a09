"""The words of riot_bus as plain data: messages, selectors, predicates, injections, trials, errors, clocks; no I/O."""
