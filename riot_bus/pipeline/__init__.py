"""Interceptors and their runner, sans-I/O: message in, messages out with due times."""
