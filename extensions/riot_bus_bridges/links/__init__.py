"""Links of MAVLink that do I/O: UDP, TCP, serial and logs, on one thread."""
