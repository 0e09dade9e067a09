"""`riot ci`: tests of a repository, for each change and each night, compared with a baseline."""
