"""The files of a finding, and what they hold."""
