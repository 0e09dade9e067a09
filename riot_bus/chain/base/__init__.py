"""What all steps share: the workspace, failing logs, systems, test cases, external fields."""
