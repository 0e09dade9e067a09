"""Trials on the workers of a Dask cluster; the only room that imports Dask, which is a pipe for bytes and no more."""
