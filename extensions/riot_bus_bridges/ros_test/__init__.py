"""Tests of others, unedited, through a router of their own: `riot ros-test`."""
